"""When the rule worker last said that it is at work, by the database's clock."""

from alembic import op

revision = "0025"
down_revision = "0024"


def upgrade() -> None:
    op.execute("alter table semap.progress add column alive_at timestamptz not null default '-infinity'")
    op.execute(
        "comment on column semap.progress.alive_at is"
        " 'When the worker last said that it is at work, by the clock of the database.'"
    )
