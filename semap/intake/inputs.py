"""What the rule worker reads off the log beside rows: rules, sources, maps that go, edited instances."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from semap.errors import InvalidInput
from semap.intake.input_row import integer_of, text_of
from semap.replication.pgoutput import Change
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import NEVER_US
from semap.timeline.stamp import parse_stamp

log = logging.getLogger(__name__)

KINDS = {"insert": "added", "update": "changed", "delete": "removed"}
NET_KINDS = {
    ("added", "changed"): "added",
    ("added", "removed"): None,
    ("changed", "removed"): "removed",
    ("removed", "added"): "changed",
}
"""What two changes of an instance in one transaction are together; else the later one."""


@dataclass(frozen=True)
class RuleChange:
    """A rule was added or edited, or removed (`rule` is None).

    backfill_from_us  from when on it is to run over what is stored; None: it is not
    seam              the last rows that were stored before it, as the database noted them
    """

    rule_id: int
    rule: Rule | None
    backfill_from_us: int | None = None
    seam: Mapping[str, int] | None = None


@dataclass(frozen=True)
class SourceChange:
    """A source as it is now.

    said_us      its watermark, or else its newest stamp; NEVER_US where it has said neither
    complete_us  up to where all of its states have come, as `semap.complete_through` says
    is_awaited   whether more is to be expected of it: it has not ended, and is not idle
    """

    map_id: int
    source_id: int
    said_us: int
    complete_us: int
    is_awaited: bool


def rule_change(change: Change) -> RuleChange | None:
    """What a change of a table does to the rules; None where that is nothing.

    raises KeyError, ValueError or InvalidInput if a column is missing or holds something else
    """
    if change.table != "rule" or change.operation == "truncate":
        return None
    rule_id = integer_of(change.row, "rule_id")
    if change.operation == "delete":
        return RuleChange(rule_id, None)
    row = change.row
    document: dict[str, object] = {
        "map_id": text_of(row, "map_id"),
        "version": text_of(row, "version"),
        "enabled": text_of(row, "enabled") == "t",
        "name": text_of(row, "name"),
        "declaration": json.loads(text_of(row, "declaration")),
        "queries": json.loads(text_of(row, "queries")),
    }
    rule = read_rule(rule_id, document)
    backfill_from, seam = row["backfill_from"], row["seam"]
    return RuleChange(
        rule_id,
        rule,
        None if backfill_from is None else parse_stamp(backfill_from),
        None if seam is None else json.loads(seam),
    )


def read_rule(rule_id: int, document: Mapping[str, object]) -> Rule | None:
    """A rule of its document; None for one that cannot be read: one row may not stop all others."""
    try:
        return Rule.from_json(rule_id, document)
    except InvalidInput as error:
        log.error("Rule %d is not in force, since it cannot be read: %s", rule_id, error)
        return None


def is_ended_by_the_map(change: Change) -> bool:
    """Whether a change is a relation that ended since the map was edited under it."""
    return (
        change.table == "relation_change"
        and change.operation == "insert"
        and change.row["kind"] == "ended"
        and change.row["cause"] == "map"
    )


def source_change(change: Change) -> SourceChange | None:
    """What a change of a table says of a source; raises as `rule_change` does."""
    if change.table != "source" or change.operation not in ("insert", "update"):
        return None
    row = change.row
    watermark, newest = row["watermark"], row["newest_stamp"]
    has_ended = text_of(row, "ended") == "t"
    said_us = _stamp_us(newest if watermark is None else watermark)
    complete_us = said_us
    if watermark is None and text_of(row, "newest_is_whole") == "f" and not has_ended:
        complete_us -= 1
    if not has_ended:
        complete_us -= _interval_us(text_of(row, "lateness"))
    if row["late_from"] is not None:
        complete_us = min(complete_us, _stamp_us(row["late_from"]) - 1)
    return SourceChange(
        integer_of(row, "map_id"),
        integer_of(row, "source_id"),
        said_us,
        max(complete_us, NEVER_US) if said_us > NEVER_US else NEVER_US,
        not has_ended and text_of(row, "idle") == "f",
    )


def deleted_source(change: Change) -> int | None:
    """The id of a source that a change deletes."""
    return _deleted(change, "source")


def deleted_map(change: Change) -> int | None:
    """The id of a map that a change deletes."""
    return _deleted(change, "map")


def map_changes(changes: Iterable[Change]) -> Mapping[int, str]:
    """Instances that a transaction added, changed or removed, by id, each once."""
    kinds: dict[int, str] = {}
    for change in changes:
        if change.table != "instance" or change.operation not in KINDS:
            continue
        instance_id, kind = integer_of(change.row, "instance_id"), KINDS[change.operation]
        before = kinds.pop(instance_id, None)
        net = NET_KINDS.get((before or "", kind), kind)
        if net is not None:
            kinds[instance_id] = net
    return kinds


def _deleted(change: Change, table: str) -> int | None:
    if change.table != table or change.operation != "delete":
        return None
    return integer_of(change.row, f"{table}_id")


def _stamp_us(text: str | None) -> int:
    return NEVER_US if text in (None, "-infinity") else parse_stamp(text)


def _interval_us(text: str) -> int:
    """Of an interval in hours, minutes and seconds, the only form that lateness has in the database."""
    hours, minutes, seconds = text.split(":")
    return round((int(hours) * 3600 + int(minutes) * 60 + float(seconds)) * 1e6)
