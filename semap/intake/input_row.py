"""Rows of tables as the rows that rules read.

A table's row comes as text, the form in which the log carries it and in which stored history is read, so that
what was and what comes are one.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from types import MappingProxyType
from uuid import UUID, uuid5

from semap.intake.map_facts import Facts, MapFacts
from semap.model.event import Event
from semap.replication.pgoutput import Row as TableRow
from semap.rules.row import RANKS, Row, Value
from semap.timeline.stamp import parse_stamp

MAP_CHANGE_NAMESPACE = UUID("9d0b8a5c-54c1-5c8e-8a5b-0f6f2b9a7d61")
MAP_INPUT = "map"
UNKNOWN = Facts(0, "", MappingProxyType({}), ())


RELATION_COLUMNS = """
    uid::text, query_name, track_id::text, track_name, subject_instance_id::text, subject_instance_name,
    instance_id::text, instance_name, object_track_id::text, object_track_name, kind::text, cause::text,
    stamp::text, since::text, transition_at::text, x_m::text, y_m::text, direction, door_id::text, door_name,
    edge::text
"""
"""What `relation_row` reads of `relation_change`, as the log would bring it."""


OF_SIDES = {
    "track": ("track_id", "track_name"),
    "subject": ("subject_instance_id", "subject_instance_name"),
    "other": ("object_track_id", "object_track_name"),
    "door": ("door_id", "door_name"),
}
"""Things of a relation beside the instance that it is to: the columns of their ids and names."""


def relation_row(row: TableRow, facts: MapFacts) -> Row:
    """The change of a relation, of `relation_change`: it stands where it was known, and says when it was.

    What a row lacks that has not all columns is null.

    raises KeyError, ValueError or InvalidInput if a column is missing or holds something else
    """
    kind, cause = text_of(row, "kind"), text_of(row, "cause")
    rank = RANKS["relation"]
    if kind == "began":
        rank += 1
    elif cause == "disappeared":
        rank += 2
    values: dict[str, Value] = {"input": text_of(row, "query_name"), "type": kind, "cause": cause}
    for name, (id_column, name_column) in OF_SIDES.items():
        number = row.get(id_column)
        if number is not None:
            values |= {name: text_of(row, name_column), f"{name}_id": int(number)}
    for name in ("x_m", "y_m"):
        place_m = row.get(name)
        if place_m is not None:
            values[name] = float(place_m)
    if row.get("direction") is not None:
        values["direction"] = row["direction"]
    if row.get("edge") is not None:
        values["edge"] = integer_of(row, "edge")
    return _row(row, facts, "relation", rank, values, row.get("transition_at"))


def object_state_row(row: TableRow, facts: MapFacts) -> Row:
    """A state of an object, of `object_state`; one that is what it was before has that as `previous`.

    raises as `relation_row` does
    """
    values: dict[str, Value] = {
        "input": text_of(row, "property"),
        "type": text_of(row, "value"),
        "previous": row["previous"],
    }
    found = _row(row, facts, "object_state", RANKS["object_state"], values)
    said = json.loads(row.get("attributes") or "{}")
    if not said:
        return found
    attributes = found.values.get("attributes")
    merged = {**(attributes if isinstance(attributes, Mapping) else {}), **said}
    return found.saying({**found.values, "attributes": merged})


def event_row(row: TableRow, facts: MapFacts) -> Row:
    """An event of a rule, of `event`, standing at its own stamp.

    raises as `relation_row` does
    """
    confidence = row["confidence"]
    values: dict[str, Value] = {
        "input": text_of(row, "rule_name"),
        "type": text_of(row, "type"),
        "cause": row["cause"],
        "measures": json.loads(text_of(row, "measures")),
        "confidence": None if confidence is None else float(confidence),
    }
    if row["track_id"] is not None:
        values |= {"track": row["track_name"], "track_id": int(row["track_id"])}
    return _row({**row, "uid": row["event_id"]}, facts, "event", RANKS["event"], values)


def event_text(event: Event) -> TableRow:
    """An event as `event` would hold it."""
    return {
        "event_id": str(event.event_id),
        "rule_name": event.rule_name,
        "type": event.type,
        "cause": event.cause,
        "measures": json.dumps(dict(event.measures)),
        "confidence": None if event.confidence is None else repr(event.confidence),
        "track_id": None if event.track_id is None else str(event.track_id),
        "track_name": event.track_name,
        "instance_id": None if event.instance_id is None else str(event.instance_id),
        "instance_name": event.instance_name,
        "stamp": event.stamp.isoformat(),
        "since": event.since.isoformat(),
    }


def map_row(instance_id: int, kind: str, committed_at_us: int, facts: MapFacts) -> Row:
    """The change of an instance by a transaction of the map, standing where that was committed.

    kind  added, changed or removed
    """
    known = facts.of(instance_id) or UNKNOWN
    uid = uuid5(MAP_CHANGE_NAMESPACE, f"{known.uid}|{kind}|{committed_at_us}")
    values = {
        "input": MAP_INPUT,
        "type": kind,
        "stamp": committed_at_us,
        "instance_id": instance_id,
        **known.values,
    }
    return Row(committed_at_us, RANKS["map"], str(uid), "map", values, known.concepts)


Reader = Callable[[TableRow, MapFacts], Row]
READERS: Mapping[str, Reader] = {
    "relation_change": relation_row,
    "object_state": object_state_row,
    "event": event_row,
}
"""By the table whose rows they read."""


def text_of(row: TableRow, column: str) -> str:
    value = row[column]
    if value is None:
        raise ValueError(f"{column} is null")
    return value


def integer_of(row: TableRow, column: str) -> int:
    return int(text_of(row, column))


def _row(
    row: TableRow,
    facts: MapFacts,
    source: str,
    rank: int,
    values: dict[str, Value],
    was: str | None = None,
) -> Row:
    """What the rows of all tables have in common: when, how long, and of which instance.

    was  the stamp at which it happened, if it was known later than that
    """
    stamp_us = parse_stamp(text_of(row, "stamp"))
    was_us = stamp_us if was is None else parse_stamp(was)
    values["stamp"] = was_us
    if was_us != stamp_us:
        values["confirmed"] = stamp_us
    since = row["since"]
    if since is not None:
        since_us = parse_stamp(since)
        values["since"] = since_us
        values["duration_s"] = (was_us - since_us) / 1e6
    known = UNKNOWN
    if row["instance_id"] is not None:
        instance_id = int(row["instance_id"])
        known = facts.of(instance_id) or UNKNOWN
        values |= known.values
        values |= {"instance": row["instance_name"], "instance_id": instance_id}
    return Row(stamp_us, rank, text_of(row, "uid"), source, values, known.concepts)  # type: ignore[arg-type]
