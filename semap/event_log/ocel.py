"""The log as OCEL 2.0 (object-centric event log, JSON): events, and what they are about."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC
from pathlib import Path
from typing import TextIO

from semap.model.event_log import ENTRY_TYPES, Entry

MAP = "Map"
TRACK = "Track"
INSTANCE = "Instance"
"""The type of instances whose concept is not known any more."""

KINDS = {"datetime": "time", "str": "string", "int": "integer", "float": "float"}
RELATED = ("event_id", "type", "stamp", "map", "track_id", "track", "instance_id", "instance", "concept")
"""What an event itself says, or its objects."""
SAID: Mapping[str, str] = {
    name: KINDS[type_] for name, type_ in ENTRY_TYPES.items() if type_ in KINDS and name not in RELATED
}


def write_ocel(entries: Iterable[Entry], path: Path) -> int:
    """Write entries in the order of their stamps; returns how many.

    An event is related to its map (qualifier `map`), its track (`actor`) and its instance (`place`). A map is
    an object of the type Map, a track of Track, an instance of its concept, such as Room.
    """
    objects: dict[str, tuple[str, str]] = {}
    types: dict[str, dict[str, str]] = {}
    count = 0
    with path.open("w", encoding="utf-8") as file:
        file.write('{"events": [')
        for entry in entries:
            document = _event(entry, objects)
            types.setdefault(entry.type, {}).update(_attribute_types(entry))
            file.write(",\n" if count else "\n")
            json.dump(document, file, ensure_ascii=False)
            count += 1
        file.write("\n],\n")
        _write(file, "objects", (_object(*each) for each in objects.items()), ",\n")
        kinds = sorted({kind for kind, _ in objects.values()})
        named = [{"name": "name", "type": "string"}]
        _write(file, "objectTypes", ({"name": kind, "attributes": named} for kind in kinds), ",\n")
        _write(file, "eventTypes", (_event_type(*each) for each in sorted(types.items())), "}\n")
    return count


def _write(file: TextIO, name: str, documents: Iterable[object], after: str) -> None:
    file.write(f'"{name}": [')
    for n, document in enumerate(documents):
        file.write(",\n" if n else "\n")
        json.dump(document, file, ensure_ascii=False)
    file.write(f"\n]{after}")


def _event(entry: Entry, objects: dict[str, tuple[str, str]]) -> dict[str, object]:
    map_ = f"map:{entry.map}"
    objects.setdefault(map_, (MAP, entry.map))
    related = [{"objectId": map_, "qualifier": "map"}]
    if entry.track_id is not None:
        track = f"track:{entry.track_id}"
        objects.setdefault(track, (TRACK, entry.track or ""))
        related.append({"objectId": track, "qualifier": "actor"})
    if entry.instance_id is not None:
        instance = f"instance:{entry.instance_id}"
        objects.setdefault(instance, (entry.concept or INSTANCE, entry.instance or ""))
        related.append({"objectId": instance, "qualifier": "place"})
    return {
        "id": str(entry.event_id),
        "type": entry.type,
        "time": entry.stamp.astimezone(UTC).isoformat(),
        "attributes": [{"name": name, "value": value} for name, value, _ in _attributes(entry)],
        "relationships": related,
    }


def _attributes(entry: Entry) -> Iterator[tuple[str, object, str]]:
    """Name, value and type of what is said of an event beside its type, time and objects."""
    for name, kind in SAID.items():
        value = getattr(entry, name)
        if value is not None:
            yield name, value.astimezone(UTC).isoformat() if kind == "time" else value, kind
    for name, value in entry.measures.items():
        if value is not None:
            plain = value if isinstance(value, bool | int | float | str) else json.dumps(value)
            yield f"measure:{name}", plain, _kind(plain)


def _kind(value: object) -> str:
    match value:
        case bool():
            return "boolean"
        case int() | float():
            return "float"
    return "string"


def _attribute_types(entry: Entry) -> dict[str, str]:
    return {name: kind for name, _, kind in _attributes(entry)}


def _object(identity: str, described: tuple[str, str]) -> dict[str, object]:
    kind, name = described
    first = "1970-01-01T00:00:00+00:00"
    return {
        "id": identity,
        "type": kind,
        "attributes": [{"name": "name", "time": first, "value": name}],
        "relationships": [],
    }


def _event_type(name: str, attributes: Mapping[str, str]) -> dict[str, object]:
    return {"name": name, "attributes": [{"name": key, "type": kind} for key, kind in attributes.items()]}
