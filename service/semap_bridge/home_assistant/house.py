"""What of a map Home Assistant is told of: its rooms, doors and rules, and which tracks are people."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from sqlalchemy import Connection, text

from semap.errors import InvalidInput
from semap.rules.declaration import Declaration
from semap.rules.language.reading import parse_declaration
from semap.store.database.connection import translated
from semap.store.event.rules import list_rules
from semap.store.motion.live import LiveMap, ShownTrack

UID = text("select uid from semap.map where name = :map")
THINGS = text("""
    select i.instance_id, i.uid::text, i.name, coalesce(i.alias, i.name), i.concept_id in (
             select semap.concepts_below(semap.concept_named('Room'))),
           coalesce((select public.st_area(a.geometry) from semap.abstraction a
                     where a.instance_id = i.instance_id and a.type = 'Footprint' limit 1), 0)
    from semap.instance i join semap.map m using (map_id)
    where m.name = :map and i.concept_id in (
      select semap.concepts_below(semap.concept_named('Room'))
      union all select semap.concepts_below(semap.concept_named('Door')))
    order by i.instance_id
""")
STILL_THERE = text("""
    select distinct t.name from semap.track t join semap.map m using (map_id)
    where m.name = :map and t.name = any (:names)
""")


@dataclass(frozen=True)
class Thing:
    """A room or a door; label: what people call it."""

    instance_id: int
    uid: str
    name: str
    label: str
    area_m2: float = 0.0


@dataclass(frozen=True)
class House:
    """What there is on a map; rules: those that are enabled."""

    rooms: Mapping[int, Thing]
    doors: Mapping[int, Thing]
    rules: Sequence[Declaration]

    def room_of(self, track: ShownTrack) -> Thing | None:
        """The smallest room that a track is in."""
        rooms = [self.rooms[each] for each in track.rooms if each in self.rooms]
        return min(rooms, key=lambda room: (room.area_m2, room.instance_id), default=None)

    def who_is_in(self, present: LiveMap, people: Mapping[str, ShownTrack]) -> Mapping[int, Sequence[str]]:
        """Names by room, in their order: a name once, however many tracks it has."""
        found: dict[int, set[str]] = {each: set() for each in self.rooms}
        for track in present.tracks.values():
            for room in track.rooms:
                if room in found and (track.name not in people or people[track.name] is track):
                    found[room].add(track.name)
        return {room: sorted(names) for room, names in found.items()}


def read_house(connection: Connection, map_name: str) -> House:
    """What there is now."""
    with translated():
        rows = connection.execute(THINGS, {"map": map_name}).all()
    rooms = {row[0]: Thing(row[0], row[1], row[2], row[3], row[5]) for row in rows if row[4]}
    doors = {row[0]: Thing(row[0], row[1], row[2], row[3]) for row in rows if not row[4]}
    rules = []
    for each in list_rules(connection, map_name=map_name, limit=None):
        try:
            if each.enabled:
                rules.append(parse_declaration(each.declaration, each.name))
        except InvalidInput:
            continue  # of a later version of semap
    return House(rooms, doors, rules)


def map_uid(connection: Connection, map_name: str) -> str | None:
    """None where there is no such map."""
    with translated():
        found = connection.scalar(UID, {"map": map_name})
    return None if found is None else found.hex


def still_there(connection: Connection, map_name: str, names: Collection[str]) -> frozenset[str]:
    """Those names that tracks of the map have."""
    with translated():
        found = connection.scalars(STILL_THERE, {"map": map_name, "names": sorted(names)})
        return frozenset(found)


def people_of(present: LiveMap, patterns: Sequence[str]) -> Mapping[str, ShownTrack]:
    """The track of each name that is one of the patterns: of several the one that was seen last."""
    newest: dict[str, ShownTrack] = {}
    for track in present.tracks.values():
        known = newest.get(track.name)
        is_wanted = any(fnmatchcase(track.name, each) for each in patterns)
        if is_wanted and (known is None or known.stamp < track.stamp):
            newest[track.name] = track
    return newest
