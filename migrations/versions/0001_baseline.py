"""The schema: the files of migrations/baseline."""

from alembic import op

from semap.store.schema import run_files

revision = "0001"
down_revision = None


def upgrade() -> None:
    run_files(op.get_bind(), "migrations/baseline")
