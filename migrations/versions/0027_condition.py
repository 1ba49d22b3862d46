"""Conditions of continuous queries, as they were compiled."""

from alembic import op

revision = "0027"
down_revision = "0026"

STATEMENTS = (
    """
    create table semap.condition (
      condition_id  integer generated always as identity primary key,
      map_id        integer not null references semap.map on delete cascade,
      kind          text not null check (kind in ('track', 'instance')),
      condition     jsonb not null,
      said          text[] not null
    )
    """,
    "create unique index condition_known on semap.condition (map_id, kind, md5(condition::text))",
    """
    comment on table semap.condition is
      'Each condition of continuous queries; what was compiled of it is the function semap.condition_<id>.'
    """,
    """
    alter table semap.continuous_query
      add column subject_condition_id integer references semap.condition,
      add column object_condition_id integer references semap.condition
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
