"""The tracks that are on a map now, found without those that have ended."""

from alembic import op

revision = "0013"
down_revision = "0012"


def upgrade() -> None:
    # Where a track is changes with every state and is in no index, so that these updates stay in their page.
    op.execute("create index track_now_live on semap.track_now (map_id) where live")
