"""Two rooms and a door between them, persons who walk through it, and who they are that open it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import shapely
from world import SECOND_US, World

from semap.timeline.stamp import to_datetime

WEST, EAST = shapely.box(0, 0, 4, 4), shapely.box(4, 0, 8, 4)
DOOR = shapely.box(3.9, 1.5, 4.1, 2.5)

BASE = {"input": ["track_in_room", {"object_state": "door", "actor_within_m": 1.5}], "partition_by": "room"}
OPENED_THEN_ENTERED = {
    **BASE,
    "pattern": "O followed by E",
    "define": {
        "O": "input = 'door' and type = 'open'",
        "E": "input = 'track_in_room' and type = 'began' and track = first(O.actor)",
    },
    "within": "6 s",
    "emit": "opened_then_entered",
}
ENTERED_THEN_CLOSED = {
    **BASE,
    "pattern": "E followed by C",
    "define": {
        "E": "input = 'track_in_room' and type = 'began'",
        "C": "input = 'door' and type = 'closed' and actor = first(E.track)",
    },
    "within": "6 s",
    "emit": "entered_then_closed",
}
LEFT_THEN_CLOSED = {
    **BASE,
    "pattern": "L followed by C",
    "define": {
        "L": "input = 'track_in_room' and type = 'ended'",
        "C": "input = 'door' and type = 'closed' and actor = first(L.track)",
    },
    "within": "6 s",
    "emit": "left_then_closed",
}
PAPER = {
    "opened_then_entered": OPENED_THEN_ENTERED,
    "entered_then_closed": ENTERED_THEN_CLOSED,
    "left_then_closed": LEFT_THEN_CLOSED,
}


@dataclass
class DoorScene:
    """The map; times in the methods are seconds since 1970."""

    world: World
    tracks: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.west_id = self.world.add_room("west", WEST)
        self.east_id = self.world.add_room("east", EAST)
        self.door_id = self.add_door("gate", DOOR, (self.west_id, self.east_id))
        self.door_source_id = self.world.add_source("doors")

    def add_door(self, name: str, footprint: shapely.Geometry, room_ids: tuple[int, ...]) -> int:
        door_id = self.world.add_room(name, footprint)
        self.world.run(
            "update semap.instance set concept_id = (select concept_id from semap.concept where name = 'Door')"
            " where instance_id = %s", door_id,
        )  # fmt: skip
        for room_id in room_ids:
            self.world.run("insert into semap.door_room values (%s, %s)", door_id, room_id)
        return door_id

    def add_rule(
        self, name: str, document: Mapping[str, object], backfill_from_s: float | None = None
    ) -> int:
        """As the store does."""
        return self.world.one(
            "insert into semap.rule (map_id, name, queries, declaration, backfill_from)"
            " values (%s, %s, %s, %s, %s) returning rule_id",
            self.world.map_id, name,
            json.dumps({"track_in_room": self.world.query_id} if "track_in_room" in str(document) else {}),
            json.dumps(document), None if backfill_from_s is None else stamp(backfill_from_s),
        )  # fmt: skip

    def door(self, value: str, at_s: float) -> None:
        self.world.run(
            "insert into semap.object_state (source_id, instance_id, property, value, stamp)"
            " values (%s, %s, 'door', %s, %s)",
            self.door_source_id, self.door_id, value, stamp(at_s),
        )  # fmt: skip

    def walk(self, name: str, way: list[tuple[float, float, float]]) -> None:
        """A person at these (second, x, y)."""
        if name not in self.tracks:
            self.tracks[name] = self.world.add_track(name)
        self.world.add_states([(self.tracks[name], us(at_s), x, y, None) for at_s, x, y in way])

    def watermark(self, at_s: float, *source_ids: int) -> None:
        """Every source, or these, has given all up to here."""
        for source_id in source_ids or (self.world.source_id, self.door_source_id):
            self.world.run(
                "update semap.source set watermark = %s where source_id = %s", stamp(at_s), source_id
            )

    def passage(self, start_s: float, actor: str = "ann", bystander: str = "bob") -> None:
        """The actor comes from the west, opens the gate, passes, and closes it; somebody stands by in the east."""
        self.walk(bystander, [(start_s + i, 7.0, 3.5) for i in range(-8, 10)])
        self.walk(
            actor,
            [(start_s - 8, 1, 2), (start_s + 1, 3, 2), (start_s + 2, 3.5, 2), (start_s + 3, 4.5, 2), (start_s + 4, 4.7, 2),
             (start_s + 9, 6, 2)],
        )  # fmt: skip
        self.door("open", start_s + 2)
        self.door("closed", start_s + 4)

    def events(self, *types: str) -> list[tuple]:
        """Type, track, room or instance of the key, and second of each event, in the order of the log."""
        return self.world.rows(
            "select type, track_name, key ->> 'room', extract(epoch from stamp)::float8"
            " from semap.event where type = any (%s) or %s order by seq", list(types), not types,
        )  # fmt: skip


def us(at_s: float) -> int:
    return round(at_s * SECOND_US)


def stamp(at_s: float):
    return to_datetime(us(at_s))
