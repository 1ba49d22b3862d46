"""Indexes for looking back: a track over time, who was where when, what happened on a map; and for pages."""

from alembic import op

revision = "0012"
down_revision = "0011"

STATEMENTS = (
    "create index track_state_track on semap.track_state (track_id, stamp)",
    """
    create index relation_change_stay on semap.relation_change using gist (tstzrange(since, stamp))
      where kind = 'ended'
    """,
    "create index relation_change_map on semap.relation_change (map_id, stamp)",
    "create index object_state_map_stamp on semap.object_state (map_id, stamp)",
    "create index event_map_stamp on semap.event (map_id, stamp, seq)",
    "create index instance_map on semap.instance (map_id, instance_id)",
    'create index instance_map_name on semap.instance (map_id, name collate "C", instance_id)',
    # A row of its own, since PostGIS keeps a transformation for further use only where it has a number.
    """
    insert into public.spatial_ref_sys (srid, auth_name, auth_srid, srtext, proj4text)
    values (990001, 'semap', 1, '', '+proj=aeqd +lat_0=0 +lon_0=0 +datum=WGS84 +units=m +no_defs')
    on conflict (srid) do nothing
    """,
)


def upgrade() -> None:
    for statement in STATEMENTS:
        op.execute(statement)
