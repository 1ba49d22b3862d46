"""States of a database of before error ellipses stay as they are, packed or not, and new ones go beside them."""

from __future__ import annotations

from server import migrate_to

from semap.store.database import connect
from semap.store.schema import migrate

OLD = """
    create table semap.track_state_20260131 (like semap.track_state including all);
    alter table semap.track_state attach partition semap.track_state_20260131
      for values from ('2026-01-31Z') to ('2026-02-01Z');
    insert into semap.map (name, uid) values ('office', gen_random_uuid());
    insert into semap.source (map_id, name) select map_id, 'lidar' from semap.map;
    insert into semap.track (uid, source_id, map_id, name) select gen_random_uuid(), source_id, map_id, 't' from semap.source;
    insert into semap.track_now (track_id, source_id, map_id, cell_m, live, first_stamp, stamp, x_m, y_m, std_m)
      select track_id, source_id, map_id, 4, true, '2026-01-31 11:00Z', '2026-01-31 12:00Z', 3, 4, 0.25 from semap.track;
    insert into semap.track_state (track_id, stamp, x_m, y_m, std_m)
      select track_id, '2026-01-31 12:00Z', 3, 4, 0.25 from semap.track;
    insert into semap.track_state_packed (track_id, from_stamp, to_stamp, states, span_us, off_high, off_low,
                                          x_high, x_middle, x_low, y_high, y_middle, y_low, std_m)
      select track_id, '2026-01-31 11:00Z', '2026-01-31 11:00Z', 1, 0, '{0}', '{-32768}',
             '{16368}', '{0}', '{0}', '{16384}', '{0}', '{0}', '{0.5}' from semap.track;
    update semap.retention set pack_after = '1 day' where kind = 'states';
"""
STATES = (
    "select extract(hour from stamp at time zone 'UTC')::int, extract(minute from stamp)::int, x_m, y_m, std_m,"
    " std_across_m, std_yaw_rad from semap.stored_state order by stamp"
)


def test_states_of_before_stay_and_ellipses_come_beside_them(empty_database: str) -> None:
    migrate_to(empty_database, "0018")
    with connect(empty_database) as connection:
        connection.execute(OLD)
        migrate(empty_database, slot=False)
        old = [(11, 0, 1, 2, 0.5, None, None), (12, 0, 3, 4, 0.25, None, None)]
        assert connection.execute(STATES).fetchall() == old
        connection.execute(
            "insert into semap.track_state (track_id, stamp, x_m, y_m, std_m, std_across_m, std_yaw_rad)"
            " select track_id, stamp, 5, 6, 2, 0.5, 0.75 from semap.track,"
            " unnest(array['2026-01-31 11:20Z', '2026-01-31 12:10Z']::timestamptz[]) stamp"
        )
        late, new = (11, 20, 5, 6, 2, 0.5, 0.75), (12, 10, 5, 6, 2, 0.5, 0.75)
        assert connection.execute(STATES).fetchall() == [old[0], late, old[1], new]
        for slot in ("2026-01-31 11:00Z", "2026-01-31 12:00Z"):
            connection.execute("select semap.pack_states(%s)", [slot])
        assert connection.execute("select count(*) from semap.track_state").fetchone() == (0,)
        assert connection.execute(STATES).fetchall() == [old[0], late, old[1], new]
        present = "select x_m, std_m, std_across_m, std_yaw_rad from semap_query.track"
        assert connection.execute(present).fetchall() == [(5, 2, 0.5, 0.75)]
