"""What operations want to know and no other table tells: how much came in, and how much of it too late."""

from alembic import op

revision = "0011"
down_revision = "0010"

STATEMENTS = (
    """
    create table semap.source_count (
      source_id      integer primary key references semap.source on delete cascade,
      track_states   bigint not null default 0,
      lines          bigint not null default 0,
      object_states  bigint not null default 0,
      received_at    timestamptz not null default clock_timestamp()
    ) with (fillfactor = 50)
    """,
    """
    comment on table semap.source_count is
      'What each source has brought in. Beside the source, whose changes all go to the rule worker.'
    """,
    "alter table semap.progress add column late_rows bigint not null default 0",
    "comment on column semap.progress.late_rows is 'How many rows came after the watermark had passed them.'",
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
