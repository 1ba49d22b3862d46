"""What rules may ask of the map: of each instance its concept, attributes, rooms and their neighbours.

The facts are those of one place in the log: loaded as they were there (`stored_facts`), and kept from there
on by the changes that the log brings.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from semap.replication.pgoutput import Change, Row
from semap.rules.row import Value

PUBLICATION = "semap_map"
OF_HISTORY = ("concept", "concept_parent", "instance", "door_room")
TABLES = ("map", *OF_HISTORY)
ROOM = "Room"


@dataclass(frozen=True, slots=True)
class Instance:
    """An instance as the log tells it; its attributes are JSON text."""

    map_id: int
    uid: str
    name: str
    concept_id: int
    attributes: str


@dataclass(frozen=True, slots=True)
class Facts:
    """What a row says of its instance.

    uid       the instance's own behind that of its map: no other instance of any database has it
    values    by the names of a row's properties; of an instance in several rooms `rooms` has a mapping each
    concepts  the instance's own and all above it
    """

    map_id: int
    uid: str
    values: Mapping[str, Value]
    concepts: tuple[str, ...]


@dataclass
class MapFacts:
    """Mutable: the instances of all maps."""

    _maps: dict[int, str] = field(default_factory=dict)
    _instances: dict[int, Instance] = field(default_factory=dict)
    _concepts: dict[int, str] = field(default_factory=dict)
    _parents: dict[int, set[int]] = field(default_factory=dict)
    _rooms_of_door: dict[int, set[int]] = field(default_factory=dict)
    _doors_of_room: dict[int, set[int]] = field(default_factory=dict)
    _gone: dict[int, Facts] = field(default_factory=dict)
    _known: dict[int, Facts] = field(default_factory=dict)
    _above: dict[int, tuple[str, ...]] = field(default_factory=dict)

    def apply(self, change: Change) -> None:
        """Take a change of a table; a deleted instance is known as it was until `settle`."""
        if change.table not in TABLES:
            return
        self._known.clear()
        is_there = change.operation != "delete"
        row = change.row
        match change.table:
            case "map":
                if is_there:  # one that goes is known on, as its instances are until the transaction is over
                    self._maps[_id(row, "map_id")] = row["uid"] or ""
            case "instance":
                self._apply_instance(row, is_there)
            case "concept":
                self._above.clear()
                if is_there:
                    self._concepts[_id(row, "concept_id")] = row["name"] or ""
                else:
                    self._concepts.pop(_id(row, "concept_id"), None)
            case "concept_parent":
                self._above.clear()
                _link(self._parents, _id(row, "concept_id"), _id(row, "parent_id"), is_there)
            case "door_room":
                door_id, room_id = _id(row, "door_id"), _id(row, "room_id")
                _link(self._rooms_of_door, door_id, room_id, is_there)
                _link(self._doors_of_room, room_id, door_id, is_there)

    def settle(self) -> None:
        """The transaction is over: what it deleted is known no more."""
        for instance_id in self._gone:
            del self._instances[instance_id]
            self._known.pop(instance_id, None)
        self._gone.clear()

    def map_uid(self, map_id: int) -> str:
        """The same in whatever database the map is; also of one that has just gone."""
        return self._maps.get(map_id, "")

    def of(self, instance_id: int) -> Facts | None:
        """What is known of an instance; None where it is not there."""
        known = self._gone.get(instance_id) or self._known.get(instance_id)
        if known is None and instance_id in self._instances:
            known = self._known[instance_id] = self._facts(instance_id)
        return known

    def _apply_instance(self, row: Row, is_there: bool) -> None:
        instance_id = _id(row, "instance_id")
        before = self._instances.get(instance_id)
        if not is_there:
            if before is not None:
                # its doors and rooms go after it
                self._gone[instance_id] = self._facts(instance_id)
            return
        self._gone.pop(instance_id, None)
        attributes = row.get("attributes", None if before is None else before.attributes)
        self._instances[instance_id] = Instance(
            _id(row, "map_id"),
            row["uid"] or "",
            row["name"] or "",
            _id(row, "concept_id"),
            attributes or "{}",
        )

    def _facts(self, instance_id: int) -> Facts:
        instance = self._instances[instance_id]
        concepts = self._concepts_above(instance.concept_id)
        values: dict[str, Value] = {
            "instance": instance.name,
            "instance_id": instance_id,
            "concept": self._concepts.get(instance.concept_id),
            "attributes": json.loads(instance.attributes),
        }
        rooms = [self._room(room_id) for room_id in self._rooms(instance_id, concepts)]
        if len(rooms) == 1:
            values |= rooms[0]
        elif rooms:
            values["rooms"] = rooms
        return Facts(instance.map_id, self._uid(instance), values, concepts)

    def _uid(self, instance: Instance) -> str:
        # the log still tells of a map that went meanwhile, whose events are not kept
        return f"{self._maps.get(instance.map_id)}/{instance.uid}"

    def _rooms(self, instance_id: int, concepts: tuple[str, ...]) -> Iterable[int]:
        if ROOM in concepts:
            return (instance_id,)
        return sorted(self._rooms_of_door.get(instance_id, set()) & self._instances.keys())

    def _room(self, room_id: int) -> dict[str, Value]:
        beyond = {
            other_id
            for door_id in self._doors_of_room.get(room_id, ())
            for other_id in self._rooms_of_door.get(door_id, ())
            if other_id != room_id and other_id in self._instances
        }
        room = self._instances[room_id]
        return {
            "room": room.name,
            "room_id": room_id,
            "room_uid": self._uid(room),
            "neighbours": sorted(self._instances[other_id].name for other_id in beyond),
        }

    def _concepts_above(self, concept_id: int) -> tuple[str, ...]:
        """The concept and all above it, nearest first."""
        known = self._above.get(concept_id)
        if known is None:
            found = [concept_id]
            for each in found:
                found += sorted(self._parents.get(each, set()) - set(found))
            known = self._above[concept_id] = tuple(
                self._concepts[each] for each in found if each in self._concepts
            )
        return known


def _id(row: Row, column: str) -> int:
    value = row[column]
    if value is None:
        raise ValueError(f"{column} is null")
    return int(value)


def _link(links: dict[int, set[int]], from_id: int, to_id: int, is_there: bool) -> None:
    if is_there:
        links.setdefault(from_id, set()).add(to_id)
    elif from_id in links:
        links[from_id].discard(to_id)
        if not links[from_id]:
            del links[from_id]
