"""All that a recording leaves in the database, but for numbers that the database gives itself."""

from __future__ import annotations

from semap.store.database.connection import connect

RESULTS = {
    "tracks": "select name, uid, ended_at from semap.track",
    "states": "select t.name, s.stamp, s.x_m, s.y_m, s.z_m, s.std_m, s.is_last, s.heading_rad, s.speed_mps,"
    " s.length_m, s.width_m, s.std_across_m, s.std_yaw_rad from semap.stored_state s join semap.track t using (track_id)",
    "lines": "select s.name, l.stamp, l.x1_m, l.y1_m, l.x2_m, l.y2_m, l.z_m, l.angle_std_rad, l.offset_std_m,"
    " l.points from semap.line_observation l join semap.source s using (source_id)",
    "doors": "select i.name, o.uid, o.property, o.value, o.stamp, o.attributes::text"
    " from semap.object_state o join semap.instance i using (instance_id)",
    "amendments": "select t.name, o.name, a.kind, a.since, a.found from semap.track_amendment a"
    " join semap.track t using (track_id) join semap.track o on o.track_id = a.other_track_id",
    "changes": "select uid, query_name, track_name, instance_name, kind, cause, stamp, since"
    " from semap.relation_change",
    "sources": "select name, watermark::text, ended, late_states from semap.source",
    "recordings": "select states_done, finished_at is not null from semap.recording",
}


def stored(dsn: str) -> dict[str, list[str]]:
    with connect(dsn) as connection:
        return {
            name: sorted(map(repr, connection.execute(said).fetchall())) for name, said in RESULTS.items()
        }
