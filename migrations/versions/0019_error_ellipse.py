"""How exact a position is in each direction: the shorter axis of its error ellipse, and how that lies."""

from alembic import op

revision = "0019"
down_revision = "0018"

STATEMENTS = (
    # `std_m` is the deviation along the longer axis; a state without these has a circle
    """
    alter table semap.track_state
      add column std_across_m real,
      add column std_yaw_rad real,
      add constraint ellipse_is_one check (
        case when std_across_m is null then std_yaw_rad is null
             else std_across_m between 0 and std_m and std_m < 1e15 and abs(std_yaw_rad) <= 7
             end is true)
    """,
    """
    comment on column semap.track_state.std_m is
      'Standard deviation of the position: of all directions, or along the longer axis of its error ellipse.'
    """,
    """
    comment on column semap.track_state.std_across_m is
      'Standard deviation along the shorter axis; null: the error is alike in all directions.'
    """,
    """
    comment on column semap.track_state.std_yaw_rad is
      'Where the longer axis of the error ellipse points, in the map frame, from x towards y.'
    """,
    "alter table semap.track_now add column std_across_m real, add column std_yaw_rad real",
    "alter type semap.arrival add attribute std_across_m real, add attribute std_yaw_rad real",
    "alter table semap.track_state_packed add column std_across_m real[], add column std_yaw_rad real[]",
    # A server that was built without lz4 keeps what it has.
    """
    do $$
    begin
      alter table semap.track_state_packed
        alter column std_across_m set compression lz4, alter column std_yaw_rad set compression lz4;
    exception when feature_not_supported then
      null;
    end $$
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
