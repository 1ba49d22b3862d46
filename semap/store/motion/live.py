"""A map as it is now, read often: who is where, how doors stand, and which change of it is the newest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, select, text

from semap.store.database.connection import translated
from semap.store.database.event_number import NEWEST

UNKNOWN = "unknown"

TRACKS = text("""
    (select json_agg(json_build_array(
              n.track_id, t.name, n.stamp, n.x_m, n.y_m, n.z_m, n.heading_rad, n.speed_mps,
              n.length_m, n.width_m, n.std_m, n.std_across_m, n.std_yaw_rad,
              array(select distinct g.instance_id from semap.region g
                    where g.region_id = any (n.region_ids || n.stateful_ids) order by 1))
              order by n.track_id)
     from semap.track_place n join semap.track t using (track_id)
     where n.map_id = m.map_id and n.live)
""")
DOORS = text("""
    (select json_agg(json_build_array(
              i.instance_id, i.name,
              case when l.instance_id is not null then n.state else s.value end,
              case when l.instance_id is not null then n.since else s.since end)
              order by i.instance_id)
     from semap.instance i
     left join semap.door_leaf l using (instance_id)
     left join semap.door_now n using (instance_id)
     left join lateral (
       select o.value,
              case when o.value = o.previous then coalesce(o.since, o.stamp) else o.stamp end as since
       from semap.object_state o
       where o.instance_id = i.instance_id and o.property = 'door' and l.instance_id is null
       order by o.stamp desc, o.uid desc limit 1) s on true
     where i.map_id = m.map_id and i.concept_id in (select semap.concepts_below(semap.concept_named('Door'))))
""")
# One statement, since a map is read often: of who asks 15 times a second, half of the work is asking.
PRESENT = (
    select(
        TRACKS,
        DOORS,
        text("(select max(change_set_id) from semap.row_version where map_id = m.map_id)"),
        NEWEST.scalar_subquery(),
        text("(select newest from semap.event_count where map_id = m.map_id)"),
    )
    .select_from(text("semap.map m"))
    .where(text("m.map_id = :map_id"))
)


@dataclass(frozen=True, slots=True)
class ShownTrack:
    """Somebody on a map, in its frame, as seen last; rooms: ids of the instances that it is in."""

    track_id: int
    name: str
    stamp: datetime
    x_m: float
    y_m: float
    z_m: float | None
    heading_rad: float | None
    speed_mps: float | None
    length_m: float | None
    width_m: float | None
    std_m: float | None
    std_across_m: float | None
    std_yaw_rad: float | None
    rooms: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ShownDoor:
    """How a door stands, as it was last seen; `unknown` where it was not."""

    instance_id: int
    name: str
    state: str
    since: datetime | None


@dataclass(frozen=True, slots=True)
class LiveMap:
    """What is on a map now, and the newest event and change of the map by then; 0 where there was none.

    event_cursor  by the numbers of all maps; own_event_cursor: by those of this one
    """

    tracks: Mapping[int, ShownTrack]
    doors: Mapping[int, ShownDoor]
    event_cursor: int
    own_event_cursor: int
    change_set: int


def live_map(connection: Connection, map_id: int) -> LiveMap | None:
    """What is on a map now; None where the map is gone."""
    with translated():
        row = connection.execute(PRESENT, {"map_id": map_id}).one_or_none()
    if row is None:
        return None
    known_tracks, known_doors, change_set, event_cursor, own_event_cursor = row
    tracks = (
        ShownTrack(*[track_id, name, datetime.fromisoformat(stamp), *measured, tuple(rooms)])
        for track_id, name, stamp, *measured, rooms in known_tracks or ()
    )
    doors = (
        ShownDoor(instance_id, name, state or UNKNOWN, since and datetime.fromisoformat(since))
        for instance_id, name, state, since in known_doors or ()
    )
    return LiveMap(
        tracks={each.track_id: each for each in tracks},
        doors={each.instance_id: each for each in doors},
        event_cursor=int(event_cursor),
        own_event_cursor=own_event_cursor or 0,
        change_set=change_set or 0,
    )
