"""Keys: rows that agree in the properties of `partition_by` are one stream of their own."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from semap.rules.row import Row, Value

Key: TypeAlias = tuple[int | float | str, ...]
"""One value for each property of `partition_by`; things by their ids."""

BY_ID = {name: f"{name}_id" for name in ("track", "subject", "other", "instance", "room", "door")}


def key_text(key: Key) -> str:
    """The key as it is stored."""
    return json.dumps(key, ensure_ascii=False, separators=(",", ":"))


def read_key(text: str) -> Key:
    """The key that `key_text` wrote."""
    return tuple(json.loads(text))


def key_reader(partition_by: Sequence[str]) -> Callable[[Row], Key | None]:
    """What gives the key of a row; None for a row that lacks one of the properties."""
    names = [BY_ID.get(name, name) for name in partition_by]
    if not names:
        return lambda row: ()
    if len(names) == 1 and partition_by[0] in BY_ID:
        return _reader_of_id(names[0])
    paths = [name.split(".") for name in names]

    def key_of(row: Row) -> Key | None:
        key = []
        for path in paths:
            part = part_of(row.values, path)
            if part is None:
                return None
            key.append(part)
        return tuple(key)

    return key_of


def _reader_of_id(name: str) -> Callable[[Row], Key | None]:
    def key_of(row: Row) -> Key | None:
        found = row.values.get(name)
        return None if found is None else (found,)  # type: ignore[return-value]

    return key_of


def part_of(values: Mapping[str, Value], path: Sequence[str]) -> int | float | str | None:
    """A text or number; truth values as their texts, since true and 1 are one key to Python."""
    value: Value = values
    for name in path:
        if not isinstance(value, Mapping):
            return None
        value = value.get(name)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and value.is_integer():
        return int(value)
    return value if isinstance(value, int | float | str) else None


def in_rooms(row: Row) -> Sequence[Row]:
    """The row for each room that it belongs to, with what is said of that room, such as its `neighbours`."""
    rooms = row.values.get("rooms")
    if not isinstance(rooms, Sequence) or isinstance(rooms, str):
        return (row,)
    return [row.saying({**row.values, **room}) for room in rooms]
