"""Continuous queries that are asked for in SQL, and what was answered."""

from alembic import op

revision = "0017"
down_revision = "0016"

STATEMENTS = (
    """
    create table semap.query_request (
      request_id   bigint generated always as identity primary key,
      map_id       integer not null references semap.map on delete cascade,
      name         text not null,
      sql          text not null,
      asked_by     text not null default current_user,
      asked_at     timestamptz not null default clock_timestamp(),
      answered_at  timestamptz,
      query_id     integer,
      refusal      jsonb,
      constraint an_answer_is_a_query_or_a_refusal
        check (num_nonnulls(query_id, refusal) = (answered_at is not null)::integer)
    )
    """,
    "create unique index query_request_waits on semap.query_request (map_id, name) where answered_at is null",
    "comment on table semap.query_request is 'Continuous queries that were asked for in SQL.'",
    """
    comment on column semap.query_request.refusal is
      'line and column in the text (null where there is no place), the reason, and the remedy.'
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
