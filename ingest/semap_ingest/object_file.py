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

from semap.errors import NotFound
from semap.model.object_state import NewObjectState
from semap.store.database.connection import open_engine, translated
from semap.store.database.name import require_plain_name
from semap.store.motion.object_states import (
    add_object_states,
    end_source,
    hold_back_source,
    names_of_no_instance,
)
from semap.timeline.stamp import MICROSECOND, to_datetime
from semap_ingest.left_out import NOTHING, TOLD, LeftOut
from semap_ingest.stamp_column import read_stamps
from semap_ingest.table_file import STAMP_NAMES, Roles, Table, named_in_errors, read_table

ROLE = "semap_ingest"
USUAL_NAMES: Mapping[str, Sequence[str]] = {
    "instance": ("instance", "object", "name", "id"),
    "property": ("property", "attribute"),
    "value": ("value", "state"),
    "stamp": STAMP_NAMES,
    "attributes": ("attributes",),
}

LONGEST_VALUE = 1000

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
    timezone    of iso stamps that say none, as Europe/Berlin or +01:00; None: each has to say its own
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    property: str | None = None
    stamp_unit: str = "iso"
    epoch_us: int = 0
    timezone: str | None = None


@dataclass(frozen=True)
class ObjectPlan:
    """Where to bring states of objects.

    keep_open  say nothing of how far the source has come: rules wait with these states for other sources
    """

    map_name: str
    source: str
    batch_size: int = 1000
    keep_open: bool = False


@dataclass(frozen=True)
class ObjectStates:
    """States in the order of their stamps.

    places    where each is in its file
    left_out  rows of the file that are not among them
    """

    states: tuple[NewObjectState, ...]
    places: tuple[str, ...]
    left_out: LeftOut = NOTHING


def read_object_states(path: Path, layout: ObjectLayout) -> ObjectStates:
    """The states of a file; rows that cannot be used are left out, and told.

    raises InvalidInput where the file cannot be read so, or has no row that can be used
    """
    given = layout.property is not None
    if layout.property is not None:
        require_plain_name(layout.property, "--property")
    roles = Roles(
        usual={role: names for role, names in USUAL_NAMES.items() if not (given and role == "property")},
        optional=("attributes",),
        named=layout.columns,
        header=layout.names,
        or_else={"property": ", or --property NAME for one property"},
    )
    with named_in_errors(path):
        table = read_table(path, roles)
        stamp_us = read_stamps(table, layout.stamp_unit, layout.epoch_us, layout.timezone)
        instance, value = table.name("instance"), table.text("value")
        name = np.full(len(table), layout.property) if given else table.name("property")
        attributes = _attributes(table)
        table.flaws.add(
            np.char.str_len(value) > LONGEST_VALUE,
            lambda _: f"the value has more than {LONGEST_VALUE} characters",
            "Shorten it, or put it into the attributes.",
        )
        left_out = table.flaws.left_out()
    order = np.flatnonzero(table.flaws.is_usable)
    order = order[np.argsort(stamp_us[order], kind="stable")]
    return ObjectStates(
        tuple(
            NewObjectState(
                str(instance[row]),
                str(name[row]),
                str(value[row]),
                to_datetime(int(stamp_us[row])),
                attributes.get(int(row), {}),
            )
            for row in order
        ),
        tuple(table.flaws.place(int(row)) for row in order),
        left_out,
    )


def ingest_object_states(
    dsn: str,
    plan: ObjectPlan,
    read: ObjectStates,
    advance: Advance = lambda done, total: None,
) -> int:
    """Write states in the order of their stamps, a batch in a transaction; returns how many were not known.

    raises  NotFound where there is no such map, or no such instance on it
    """
    require_plain_name(plan.source, "--source")
    engine = open_engine(dsn, ROLE, application="semap ingest", size=1)
    states, added = read.states, 0
    try:
        with translated(), engine.begin() as connection:
            first = _first_places(read)
            lacking = names_of_no_instance(connection, plan.map_name, list(first))
            if lacking:
                raise _no_instances(plan.map_name, {name: first[name] for name in lacking})
            if plan.keep_open:
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


def _first_places(read: ObjectStates) -> Mapping[str, str]:
    """Where each instance is named first."""
    return {
        each.instance: place for each, place in zip(reversed(read.states), reversed(read.places), strict=True)
    }


def _no_instances(map_name: str, first: Mapping[str, str]) -> NotFound:
    told = [f"{place}: There is no instance {name} on the map {map_name}." for name, place in first.items()]
    more = [f"and {len(told) - TOLD} more"] if len(told) > TOLD else []
    return NotFound.said(
        "\n  ".join([*told[:TOLD], *more]),
        "List its instances: semap map export; or name another column: --instance-column.",
    )


def _watermark(states: Sequence[NewObjectState], done: int) -> datetime:
    """Up to where no state is still to come."""
    return states[-1].stamp if done == len(states) else states[done].stamp - MICROSECOND


def _attributes(table: Table) -> Mapping[int, Mapping[str, object]]:
    """By row, where it has any."""
    found: dict[int, Mapping[str, object]] = {}
    is_wrong = np.zeros(len(table), dtype=np.bool_)
    for row, cell in enumerate(
        np.char.strip(table.columns["attributes"]) if "attributes" in table.columns else ()
    ):
        if not cell:
            continue
        try:
            given = json.loads(str(cell))
            # PostgreSQL keeps no NUL, no half of a pair of surrogates, and no number that is none
            text = json.dumps(given, allow_nan=False, ensure_ascii=False)
            is_wrong[row] = not isinstance(given, dict) or "\\u0000" in text or not text.encode()
            found[row] = given
        except (ValueError, RecursionError):
            is_wrong[row] = True
    table.flaws.add(
        is_wrong,
        lambda _: "the attributes are no JSON object that can be stored",
        'Write them as {"by": "ann"}.',
    )
    return found
