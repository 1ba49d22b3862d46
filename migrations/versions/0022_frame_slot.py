"""Where the state of a track is in the arrays of a frame."""

from alembic import op

revision = "0022"
down_revision = "0021"

STATEMENTS = (
    """
    alter table semap.track_now add column slot integer
    """,
    """
    comment on column semap.track_now.slot is
      'The place of the track in source_count.frame_track_ids, from 1; of no meaning where that is null.'
    """,
    # who has a frame before has no slots yet: the next one is of rows, and gives them
    """
    update semap.source_count set frame_tracks = null, frame_track_ids = null
    where frame_track_ids is not null
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
