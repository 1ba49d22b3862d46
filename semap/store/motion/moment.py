"""What was when: a map at a moment, and what happened between two, all in event time.

A track that ends is gone at the stamp of its end. One that was not seen for a while before the moment is
there only if it was in an instance then, since nobody knows what else became of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import Connection, text

from semap.store.database.connection import translated
from semap.store.map.maps import map_id_of
from semap.store.motion.live import UNKNOWN, ShownDoor, ShownTrack

MOST_TRAIL_POINTS = 200

STAYING = text("""
    select track_id, array_agg(distinct instance_id), min(since)
    from semap.stays(:map_id, :at, :at)
    group by track_id
""")
SEEN = """
    select s.track_id, t.name, s.stamp, s.x_m, s.y_m, s.z_m, s.heading_rad, s.speed_mps,
           s.length_m, s.width_m, s.std_m, s.std_across_m, s.std_yaw_rad,
           s.is_last or coalesce(t.ended_at <= :at, false) as ended
    from semap.states_of_map(:map_id, :since, :at) s join semap.track t using (track_id)
"""
RECENT = text(f"""
    with numbered as materialized (
      select *, count(*) over one_track - row_number() over (one_track order by stamp) as back,
             count(*) filter (where stamp >= :trail_since) over one_track as points
      from ({SEEN}) seen
      window one_track as (partition by track_id)
    ), trail as materialized ( -- in the order of the window: to sort once more would take as long as all else
      select track_id, '[' || string_agg(
               '[' || x_m || ',' || y_m || ',' || date_part('epoch', stamp - :at) || ']', ',') || ']' as trail
      from numbered
      where stamp >= :trail_since and back % ((points + {MOST_TRAIL_POINTS - 1}) / {MOST_TRAIL_POINTS}) = 0
      group by track_id
    )
    select n.track_id, n.name, n.stamp, n.x_m, n.y_m, n.z_m, n.heading_rad, n.speed_mps,
           n.length_m, n.width_m, n.std_m, n.std_across_m, n.std_yaw_rad, n.ended,
           coalesce(t.trail, '[]')::json as trail
    from numbered n left join trail t using (track_id)
    where n.back = 0
""")  # noqa: S608
LONG_SEEN = text("""
    select k.track_id, t.name, s.stamp, s.x_m, s.y_m, s.z_m, s.heading_rad, s.speed_mps,
           s.length_m, s.width_m, s.std_m, s.std_across_m, s.std_yaw_rad,
           s.is_last or coalesce(t.ended_at <= :at, false) as ended,
           '[]'::json as trail
    from unnest(cast(:track_ids as bigint[]), cast(:since as timestamptz[])) k (track_id, since)
    join semap.track t using (track_id)
    cross join lateral semap.states_around(
      k.track_id, cast(:at as timestamptz) + interval '1 us', 1, 0, 'infinity', k.since) s
""")
DOORS = text("""
    select i.instance_id, i.name, s.state, s.since
    from semap.instance i
    left join semap.door_states(:map_id, :at, :at) s on s.instance_id = i.instance_id
    where i.map_id = :map_id and i.concept_id in (select semap.concepts_below(semap.concept_named('Door')))
    order by i.instance_id
""")
CURSOR = text("""
    select seq from semap.event where map_id = :map_id and stamp <= :at order by stamp desc, seq desc limit 1
""")
OWN_CURSOR = text("""
    select n.number from semap.event e join semap.event_number n using (event_id)
    where e.map_id = :map_id and e.stamp <= :at order by e.stamp desc, n.number desc limit 1
""")
CHANGE_SET = text("select max(change_set_id) from semap.row_version where map_id = :map_id")
STAYS = text("""
    select s.instance_id, coalesce(i.name, (
             select p.instance_name from semap.relation_past p
             where p.instance_id = s.instance_id and p.map_id = :map_id
               and p.until = s.until and tstzrange(p.since, p.until, '[]') @> s.until limit 1), ''),
           s.track_id, t.name, min(s.since), s.until
    from semap.stays(:map_id, :from, :to) s
    join semap.track t using (track_id)
    left join semap.instance i on i.instance_id = s.instance_id
    group by s.instance_id, i.name, s.track_id, t.name, s.until
    order by min(s.since), s.instance_id, s.track_id limit :limit
""")
STAYS_OF_TRACK = text("""
    select s.instance_id, coalesce(max(i.name), max(p.instance_name), ''), t.track_id, t.name,
           min(s.since) as since, s.until
    from semap.track t
    cross join semap.stays(t.map_id, :from, :to) s
    left join semap.instance i on i.instance_id = s.instance_id
    left join semap.relation_past p on p.track_id = s.track_id and p.instance_id = s.instance_id
      and p.until = s.until and tstzrange(p.since, p.until, '[]') @> s.until
    where t.track_id = :track_id and s.track_id = t.track_id
    group by s.instance_id, t.track_id, t.name, s.until
    order by s.until desc nulls first, since desc, s.instance_id limit :limit
""")
DOOR_STATES = text("""
    select instance_id, name, state, since, until
    from semap.door_states(:map_id, :from, :to) order by since, instance_id limit :limit
""")
LAST = text("""
    select greatest(
      (select max(nullif(n.stamp, '-infinity')) from semap.track_place n where n.map_id = :map_id),
      (select stamp from semap.relation_change where map_id = :map_id order by stamp desc limit 1),
      (select max(stamp) from semap.object_state where map_id = :map_id),
      (select stamp from semap.event where map_id = :map_id order by stamp desc limit 1))
""")
FIRST = text("""
    select least(
      (select stamp from semap.relation_change where map_id = :map_id order by stamp limit 1),
      (select min(stamp) from semap.object_state where map_id = :map_id),
      (select stamp from semap.event where map_id = :map_id order by stamp limit 1))
""")
FIRST_STATE = text("select semap.first_state_of_map(:map_id)")


@dataclass(frozen=True, slots=True)
class PastTrack(ShownTrack):
    """A track as it was seen last by a moment.

    trail  x [m], y [m] and time [s, at most 0, from the moment on] of each state, the oldest first
    """

    trail: list[list[float]]


@dataclass(frozen=True)
class Moment:
    """A map at a moment.

    occupants     how many tracks were in each instance, by its id, where there were any
    event_cursor  the number of the newest event by then; 0 where there was none
    change_set    the newest change of the map until now, 0 where there was none
    """

    tracks: tuple[PastTrack, ...]
    doors: tuple[ShownDoor, ...]
    occupants: Mapping[int, int]
    event_cursor: int
    change_set: int


@dataclass(frozen=True)
class Stay:
    """A track was in an instance; `until` is None while it holds."""

    instance_id: int
    instance: str
    track_id: int
    track: str
    since: datetime
    until: datetime | None


@dataclass(frozen=True)
class DoorState:
    """A door stood so; `until` is None while it holds."""

    instance_id: int
    door: str
    state: str
    since: datetime
    until: datetime | None


def moment(
    connection: Connection,
    map_name: str,
    at: datetime,
    *,
    trail_s: float = 10,
    within_s: float = 10,
    own: bool = False,
) -> Moment:
    """A map as it was at a moment.

    trail_s   how far back trails go
    within_s  a track outside of all instances is there if it was seen so long before
    own       events are told by the numbers of the map
    raises    NotFound if there is no such map
    """
    map_id = map_id_of(connection, map_name)
    asked = {"map_id": map_id, "at": at}
    with translated():
        staying = {
            track_id: (sorted(rooms), since) for track_id, rooms, since in connection.execute(STAYING, asked)
        }
        spans = {"since": within_s, "trail_since": trail_s}
        bounds = {name: _before(at, seconds) for name, seconds in spans.items()}
        bounds["since"] = min(bounds.values())
        seen = {row.track_id: row for row in connection.execute(RECENT, {**asked, **bounds})}
        unseen = {track_id: since for track_id, (_, since) in staying.items() if track_id not in seen}
        if unseen:
            long_ago = {"track_ids": list(unseen), "since": list(unseen.values())}
            seen |= {row.track_id: row for row in connection.execute(LONG_SEEN, {**asked, **long_ago})}
        doors = connection.execute(DOORS, asked).all()
        event_cursor = connection.scalar(OWN_CURSOR if own else CURSOR, asked) or 0
        change_set = connection.scalar(CHANGE_SET, {"map_id": map_id}) or 0
    least = _before(at, within_s)
    shown = sorted((row for row in seen.values() if not row.ended), key=lambda row: int(row.track_id))
    tracks = tuple(
        PastTrack(*(*known, tuple(staying.get(row.track_id, ((), at))[0]), trail))
        for row in shown
        if row.stamp >= least or row.track_id in staying
        for *known, _, trail in [row]
    )
    occupants: dict[int, int] = {}
    for rooms, _ in staying.values():
        for instance_id in rooms:
            occupants[instance_id] = occupants.get(instance_id, 0) + 1
    return Moment(
        tracks,
        tuple(ShownDoor(id_, name, state or UNKNOWN, since) for id_, name, state, since in doors),
        dict(sorted(occupants.items())),
        event_cursor,
        change_set,
    )


def stays(
    connection: Connection, map_name: str, start: datetime, end: datetime, limit: int
) -> tuple[Stay, ...]:
    """Who was in which instance at some time from `start` to `end`, at most `limit`, as they began.

    raises  NotFound if there is no such map
    """
    return tuple(Stay(*row) for row in _between(connection, STAYS, map_name, start, end, limit))


def stays_of_track(
    connection: Connection, track_id: int, start: datetime, end: datetime, limit: int
) -> tuple[Stay, ...]:
    """The newest stays of a track from `start` to `end`, at most `limit`, the last first.

    None where there is no such track.
    """
    asked = {"track_id": track_id, "from": start, "to": end, "limit": limit}
    with translated():
        return tuple(Stay(*row) for row in connection.execute(STAYS_OF_TRACK, asked))


def door_states(
    connection: Connection, map_name: str, start: datetime, end: datetime, limit: int
) -> tuple[DoorState, ...]:
    """How doors stood from `start` to `end`, at most `limit` in the order of their beginning.

    raises  NotFound if there is no such map
    """
    return tuple(DoorState(*row) for row in _between(connection, DOOR_STATES, map_name, start, end, limit))


def extent(connection: Connection, map_name: str) -> tuple[datetime, datetime] | None:
    """The first and the last stamp of all that was told of a map; None where nothing was.

    raises  NotFound if there is no such map
    """
    asked = {"map_id": map_id_of(connection, map_name)}
    with translated():
        last = connection.scalar(LAST, asked)
        if last is None:
            return None
        firsts = (
            connection.scalar(FIRST, asked),
            connection.scalar(FIRST_STATE, asked),
        )
    stamps = [each for each in firsts if each is not None]
    return min([last, *stamps]), last


def _between(
    connection: Connection, statement: Any, map_name: str, start: datetime, end: datetime, limit: int
) -> list[Any]:
    asked = {"map_id": map_id_of(connection, map_name), "from": start, "to": end, "limit": limit}
    with translated():
        return list(connection.execute(statement, asked))


def _before(at: datetime, seconds: float) -> datetime:
    """So long before, where the calendar reaches that far."""
    try:
        return at - timedelta(seconds=seconds)
    except OverflowError:
        return at
