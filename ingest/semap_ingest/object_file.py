"""States of objects in a table: CSV (any usual delimiter) or Parquet, one row per state.

They are written batch by batch, each with the watermark of their source. What is stored already is known by
its identity and passed over, so that a file may be brought in again, and after a crash goes on where it was.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from semap.errors import InvalidInput
from semap.store.database import open_engine, translated
from semap.store.object_states import NewObjectState, add_object_states, end_source, hold_back_source
from semap.timeline.stamp import MICROSECOND, to_datetime
from semap_ingest.table_file import STAMP_NAMES, Roles, Table, read_stamps, read_table

ROLE = "semap_ingest"
USUAL_NAMES: Mapping[str, Sequence[str]] = {
    "instance": ("instance", "object", "name", "id"),
    "property": ("property", "attribute"),
    "value": ("value", "state"),
    "stamp": STAMP_NAMES,
    "attributes": ("attributes",),
}

LONGEST_VALUE = 1000
NO_TEXT = ("\0", "\ufffd")
"""What no database keeps, and what stands for bytes that are no text."""

Advance = Callable[[int, int], None]
"""Called with the states done and the states in all."""


@dataclass(frozen=True)
class ObjectLayout:
    """How to read a file.

    columns     what is in which column, where it has not one of the usual names
    names       names of the columns of a file without a header
    property    of all states, in a file without a column for it
    stamp_unit  iso, s, ms, us, ns, or frames at a rate: 25fps
    epoch_us    the time of stamp 0 [us since 1970]; not for iso
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    property: str | None = None
    stamp_unit: str = "iso"
    epoch_us: int = 0


@dataclass(frozen=True)
class ObjectPlan:
    """Where to bring states of objects.

    keep_open  say nothing of how far the source has come: rules wait with these states for other sources
    """

    map_name: str
    source: str
    batch_size: int = 1000
    keep_open: bool = False


def read_object_states(path: Path, layout: ObjectLayout) -> tuple[NewObjectState, ...]:
    """The states of a file in the order of their stamps.

    raises InvalidInput where the file cannot be read so, naming the line where there is one
    """
    given = layout.property is not None
    roles = Roles(
        usual={role: names for role, names in USUAL_NAMES.items() if not (given and role == "property")},
        optional=("attributes",),
        named=layout.columns,
        header=layout.names,
        or_else={"property": ", or --property NAME for one property"},
    )
    table = read_table(path, roles)
    stamp_us, has_stamp = read_stamps(table.columns["stamp"], layout.stamp_unit, layout.epoch_us)
    if not has_stamp.all():
        raise _wrong(table, int(np.argmin(has_stamp)), "no finite stamp")
    order = np.argsort(stamp_us, kind="stable")
    return tuple(_state(table, int(row), int(stamp_us[row]), layout.property) for row in order)


def ingest_object_states(
    dsn: str,
    plan: ObjectPlan,
    states: Sequence[NewObjectState],
    advance: Advance = lambda done, total: None,
) -> int:
    """Write states in the order of their stamps, a batch in a transaction; returns how many were not known.

    raises  NotFound where there is no such map, or no such instance on it
    """
    engine = open_engine(dsn, ROLE, application="semap ingest", size=1)
    added = 0
    try:
        if plan.keep_open:
            with translated(), engine.begin() as connection:
                hold_back_source(connection, plan.map_name, plan.source)
        for begin in range(0, len(states), plan.batch_size):
            end = min(begin + plan.batch_size, len(states))
            watermark = None if plan.keep_open else _watermark(states, end)
            with translated(), engine.begin() as connection:
                added += len(
                    add_object_states(
                        connection, plan.map_name, plan.source, states[begin:end], watermark=watermark
                    )
                )
            advance(end, len(states))
        with translated(), engine.begin() as connection:
            end_source(connection, plan.map_name, plan.source)
    finally:
        engine.dispose()
    return added


def _watermark(states: Sequence[NewObjectState], done: int) -> datetime:
    """Up to where no state is still to come."""
    return states[-1].stamp if done == len(states) else states[done].stamp - MICROSECOND


def _state(table: Table, row: int, stamp_us: int, property_name: str | None) -> NewObjectState:
    cells = {role: str(column[row]).strip() for role, column in table.columns.items()}
    name = property_name or cells["property"]
    if not cells["instance"] or not name:
        raise _wrong(table, row, "no instance or no property")
    if any(sign in cell for cell in cells.values() for sign in NO_TEXT):
        raise _wrong(table, row, "a text that is not in UTF-8, or NUL in it")
    if len(cells["value"]) > LONGEST_VALUE:
        raise _wrong(table, row, f"a value of more than {LONGEST_VALUE} characters")
    return NewObjectState(
        cells["instance"],
        name,
        cells["value"],
        to_datetime(stamp_us),
        _attributes(table, row, cells.get("attributes", "")),
    )


def _attributes(table: Table, row: int, text: str) -> Mapping[str, object]:
    try:
        found = json.loads(text) if text else {}
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise _wrong(table, row, "the attributes are no JSON object")
    return found


def _wrong(table: Table, row: int, what: str) -> InvalidInput:
    return InvalidInput(what, "Mend the row, or remove it.", f"near line {table.first_line + row}")
