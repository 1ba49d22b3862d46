"""A map as it is now, read often: who is where, how doors stand, and which change of it is the newest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import Connection, text

from semap.store.database.connection import translated
from semap.store.database.event_number import newest_event

UNKNOWN = "unknown"

TRACKS = text("""
    select n.track_id, t.name, n.stamp, n.x_m, n.y_m, n.z_m, n.heading_rad, n.speed_mps,
           n.length_m, n.width_m, n.std_m, n.std_across_m, n.std_yaw_rad,
           array(select distinct g.instance_id from semap.region g
                          where g.region_id = any (n.region_ids || n.stateful_ids) order by 1)
    from semap.track_place n join semap.track t using (track_id)
    where n.map_id = :map_id and n.live
    order by n.track_id
""")
DOORS = text("""
    select i.instance_id, i.name,
           case when l.instance_id is not null then n.state else s.value end,
           case when l.instance_id is not null then n.since else s.since end
    from semap.instance i
    left join semap.door_leaf l using (instance_id)
    left join semap.door_now n using (instance_id)
    left join lateral (
      select o.value, case when o.value = o.previous then coalesce(o.since, o.stamp) else o.stamp end as since
      from semap.object_state o
      where o.instance_id = i.instance_id and o.property = 'door' and l.instance_id is null
      order by o.stamp desc, o.uid desc limit 1) s on true
    where i.map_id = :map_id and i.concept_id in (select semap.concepts_below(semap.concept_named('Door')))
    order by i.instance_id
""")
CHANGE_SET = text("select max(change_set_id) from semap.row_version where map_id = :map_id")
IS_THERE = text("select exists (select from semap.map where map_id = :map_id)")


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


OWN_EVENTS = text("select newest from semap.event_count where map_id = :map_id")


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
    wanted = {"map_id": map_id}
    with translated():
        if not connection.scalar(IS_THERE, wanted):
            return None
        # Numbers first: what is committed meanwhile is then told once more, and never left out.
        change_set, event_cursor = connection.scalar(CHANGE_SET, wanted), newest_event(connection)
        own_event_cursor = connection.scalar(OWN_EVENTS, wanted) or 0
        tracks = (ShownTrack(*[*known, tuple(rooms)]) for *known, rooms in connection.execute(TRACKS, wanted))
        doors = (
            ShownDoor(instance_id, name, state or UNKNOWN, since)
            for instance_id, name, state, since in connection.execute(DOORS, wanted)
        )
        return LiveMap(
            tracks={each.track_id: each for each in tracks},
            doors={each.instance_id: each for each in doors},
            event_cursor=event_cursor,
            own_event_cursor=own_event_cursor,
            change_set=change_set or 0,
        )
