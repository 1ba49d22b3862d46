"""Records of a topic as states: JSON, a state each, or many as rows or columns (`semap_ingest/state_json`).

The key of a record is the name of the track, where its state names none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from pydantic_core import from_json
from semap_ingest.named_states import NO_STATES, NamedStates, Refused
from semap_ingest.state_json import states_of

from semap.errors import InvalidInput
from semap.model.object_state import NewObjectState
from semap_bridge.adapter import Batch
from semap_bridge.lines import batch_of_lines


class Record(Protocol):
    """A record of a topic, as a consumer gives it."""

    def key(self) -> bytes | None: ...

    def value(self) -> bytes | None: ...

    def partition(self) -> int | None: ...

    def offset(self) -> int | None: ...


def batch_of_records(records: Sequence[Record]) -> Batch:
    """What they say, in their order; what cannot be read is among the refused, with its place."""
    parts: list[NamedStates] = []
    objects: list[NewObjectState] = []
    refused: list[Refused] = []
    rows: list[object] = []
    first_row: list[int] = []

    def read_rows() -> None:
        states, flawed = states_of(rows) if rows else (NO_STATES, [])
        parts.append(states)
        refused.extend(_placed(each, first_row[each.index], records) for each in flawed)
        rows.clear()
        first_row.clear()

    for number, record in enumerate(records):
        try:
            value = _value(record)
            if isinstance(value, dict) and "instance" in value:
                said = batch_of_lines([record.value() or b""])
                objects += said.objects
                refused += [_placed(each, number, records) for each in said.refused]
            elif isinstance(value, dict) and list not in map(type, value.values()):
                rows.append(value)
                first_row.append(number)
            else:
                read_rows()
                states, flawed = states_of(value)
                parts.append(states)
                refused += [_placed(each, number, records) for each in flawed]
        except InvalidInput as error:
            refused.append(_placed(Refused(number, "no state", str(error)), number, records))
        except ValueError as error:
            refused.append(_placed(Refused(number, "not JSON", str(error)), number, records))
    read_rows()
    whole = [each for each in parts if len(each)]
    return Batch(NamedStates.joined(whole) if whole else NO_STATES, objects, refused=refused)


def _value(record: Record) -> object:
    """raises ValueError, InvalidInput"""
    if (said := record.value()) is None:
        raise InvalidInput("it has no value", "A track ends by a state with is_last.")
    value = from_json(said)
    if type(value) is dict and "track" not in value and "instance" not in value and (key := record.key()):
        value["track"] = key.decode()
    return value


def _placed(refused: Refused, number: int, records: Sequence[Record]) -> Refused:
    place = f"partition {records[number].partition()} at {records[number].offset()}"
    return replace(refused, index=number, detail=f"{place}: {refused.detail}")
