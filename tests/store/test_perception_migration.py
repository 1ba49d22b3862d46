"""A database of an older semap goes on: its tracks take their room, its doors get leaves, its days get lines."""

from __future__ import annotations

from server import migrate_to

from semap.store.database import connect
from semap.store.schema import migrate

OLD = """
    create table semap.track_state_20260131 (like semap.track_state including all);
    alter table semap.track_state attach partition semap.track_state_20260131
      for values from ('2026-01-31Z') to ('2026-02-01Z');
    insert into semap.concept (name) values ('Door') on conflict do nothing;
    insert into semap.map (name, uid) values ('office', gen_random_uuid());
    insert into semap.frame (map_id, name) select map_id, 'map' from semap.map;
    insert into semap.frame_pose (frame_id) select frame_id from semap.frame;
    insert into semap.instance (map_id, name, concept_id, frame_id, attributes)
      select map_id, said.name, concept_id, frame_id, said.attributes::jsonb
      from semap.frame cross join semap.concept c
      cross join (values ('gate', '{"width_m": 1, "leaf": "left"}'), ('odd', '{"width_m": 1, "leaf": 7}')) said (name, attributes)
      where c.name = 'Door';
    insert into semap.source (map_id, name) select map_id, 'lidar' from semap.map;
    insert into semap.recording (source_id, fingerprint, path, states_total) select source_id, 'f', 'p', 5 from semap.source;
    insert into semap.track (uid, source_id, map_id, name) select gen_random_uuid(), source_id, map_id, 't' from semap.source;
    insert into semap.track_now (track_id, source_id, map_id, cell_m) select track_id, source_id, map_id, 4 from semap.track;
    insert into semap.track_state (track_id, stamp, x_m, y_m) select track_id, '2026-01-31 12:00Z', 1, 2 from semap.track;
"""


def test_tracks_doors_and_days_go_on(empty_database: str) -> None:
    migrate_to(empty_database, "0007")
    with connect(empty_database) as connection:
        connection.execute(OLD)
        migrate(empty_database, slot=False)
        assert connection.execute(
            "select i.name, n.state from semap.door_now n join semap.instance i using (instance_id)"
        ).fetchall() == [("gate", None)]
        connection.execute("select semap.ensure_partitions(array[date '2026-01-31'])")
        connection.execute(
            "insert into semap.line_observation"
            " (source_id, stamp, x1_m, y1_m, x2_m, y2_m, angle_std_rad, offset_std_m, points)"
            " select source_id, '2026-01-31 12:00Z', -0.48, 0, 0.45, 0, 0.01, 0.01, 9 from semap.source"
        )
        connection.execute(
            "insert into semap.track_state (track_id, stamp, x_m, y_m, heading_rad, length_m)"
            " select track_id, '2026-01-31 12:00:01Z', 1, 2, 0, 0.5 from semap.track"
        )
        assert connection.execute(
            "select tableoid::regclass::text from semap.line_observation"
        ).fetchall() == [("semap.line_observation_20260131",)]
        assert connection.execute("select door, state from semap.door_present").fetchall() == [
            ("gate", "closed")
        ]
        assert connection.execute("select track, length_m, width_m from semap.track_present").fetchall() == [
            ("t", 0.5, None)
        ]
        assert connection.execute("select states_total from semap.recording").fetchall() == [(5,)]
        # applied again, behaviour leaves doors as they stand
        connection.execute("update semap.behaviour set checksum = 'older'")
        assert migrate(empty_database, slot=False).behaviour_changed
        assert connection.execute("select state from semap.door_now").fetchall() == [("closed",)]
