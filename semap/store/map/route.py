"""Ways through doors between things and tracks, from the room of one to the room of the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from sqlalchemy import Connection, text

from semap.errors import InvalidInput, NotFound
from semap.model.route import Gap, Part, Route, RouteStep
from semap.store.database.connection import translated

ROOM_ITSELF = """
    select i.instance_id, i.name, i.map_id from semap.instance i
    where i.instance_id = :id and i.concept_id in (select semap.concepts_below(semap.concept_named('Room')))
"""
ROOM_OF_INSTANCE = text(f"""
    select * from (
      {ROOM_ITSELF}
      union all
      (select r.instance_id, r.name, i.map_id
       from semap.instance i cross join lateral semap.rooms_around(i.instance_id) r
       where i.instance_id = :id limit 1)
      union all
      (select r.instance_id, r.name, r.map_id
       from semap.door_room j join semap.instance r on r.instance_id = j.room_id
       where j.door_id = :id order by r.instance_id limit 1)
    ) room limit 1
""")  # noqa: S608  (a constant)
ROOM_OF_TRACK = text("""
    select i.instance_id, i.name, i.map_id
    from semap.relation n
    join semap.instance i using (instance_id)
    join semap.abstraction a on a.instance_id = i.instance_id and a.type = 'Footprint'
    where n.track_id = :id and n.confirmed and not n.in_pairs
      and i.concept_id in (select semap.concepts_below(semap.concept_named('Room')))
    order by public.st_area(a.geometry), i.instance_id limit 1
""")
KNOWN = {
    "instance": text("select 1 from semap.instance where instance_id = :id"),
    "track": text("select 1 from semap.track where track_id = :id"),
}
ROUTE = text("""
    select r.step, r.room_id, r.room, r.door_id, r.door, r.length_m, r.total_m, p.x_m, p.y_m, p.z_m
    from semap.route(:from, :to) r
    left join lateral semap.way_points(array[coalesce(r.door_id, r.room_id)]) p on true
    order by r.step
""")
PART = text(r"""
    select count(*), (array_agg(r.name order by r.name))[1\:20],
           array_agg(distinct s.name) filter (where s.name is not null)
    from semap.rooms_connected(:room_id) c (room_id)
    join semap.instance r on r.instance_id = c.room_id
    left join semap.instance s on s.instance_id = r.storey_id
""")
END = text("select x_m, y_m, z_m from semap.way_points(array[cast(:room_id as bigint)])")


@dataclass(frozen=True)
class Place:
    """An instance or a track by its id."""

    kind: Literal["instance", "track"]
    id: int


def way(connection: Connection, start: Place, end: Place) -> Route:
    """The shortest way through doors from the room of one thing to that of another.

    raises  NotFound for an unknown thing, InvalidInput for one that is in no room, or on another map
    """
    from_id, from_map = _room_of(connection, start, "from")
    to_id, to_map = _room_of(connection, end, "to")
    if from_map != to_map:
        raise InvalidInput("both are on different maps", "Give two things of one map.", "to")
    with translated():
        rows = connection.execute(ROUTE, {"from": from_id, "to": to_id}).all()
        if not rows:
            return Route((), None, (), Gap(_part(connection, from_id), _part(connection, to_id)))
        places = [row[7:] for row in rows]
        if to_id != from_id:
            places.append(connection.execute(END, {"room_id": to_id}).one())
    line = tuple(tuple(part for part in place if part is not None) for place in places)
    return Route(tuple(RouteStep(*row[1:6]) for row in rows), rows[0].total_m, line)


def _part(connection: Connection, room_id: int) -> Part:
    rooms, names, storeys = connection.execute(PART, {"room_id": room_id}).one()
    return Part(rooms, tuple(names), tuple(storeys or ()))


def _room_of(connection: Connection, place: Place, where: str) -> tuple[int, int]:
    with translated():
        if connection.scalar(KNOWN[place.kind], {"id": place.id}) is None:
            raise NotFound(place.kind, place.id, f"List the {place.kind}s to see their ids.")
        statement = ROOM_OF_INSTANCE if place.kind == "instance" else ROOM_OF_TRACK
        found = connection.execute(statement, {"id": place.id}).one_or_none()
    if found is None:
        raise InvalidInput(
            f"{place.kind} {place.id} is in no room", "Give a room, or something that is in one.", where
        )
    return found.instance_id, found.map_id
