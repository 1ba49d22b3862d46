"""What late states may correct: since when a region has its form."""

from alembic import op

revision = "0018"
down_revision = "0017"

STATEMENTS = (
    # Tracks that are older than the form of a region are corrected only after the newest state of its map.
    """
    alter table semap.region
      add column formed_stamp timestamptz not null default '-infinity',
      add column formed_track_id bigint not null default 0
    """,
    """
    update semap.region r
    set formed_stamp = n.stamp, formed_track_id = n.track_id
    from (select map_id, max(stamp) as stamp, max(track_id) as track_id
          from semap.track_now group by map_id) n
    where n.map_id = r.map_id
    """,
    # between which stamps what is found of a region may differ from what was found without late states
    "create type semap.replayed as (region_id integer, from_stamp timestamptz, to_stamp timestamptz)",
    """
    create type semap.amended as (
      region_id integer, kind semap.change_kind, cause semap.change_cause,
      stamp timestamptz, edge_at timestamptz, since timestamptz, x_m double precision, y_m double precision
    )
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
