"""The schema: the files of migrations/baseline, in their order."""

from pathlib import Path

from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    cursor = op.get_bind().connection.cursor()
    for file in sorted(Path(__file__).parents[1].glob("baseline/*.sql")):
        cursor.execute(file.read_text())
