"""Steps as records of a log between intake and rules.

A record is what one transaction of a shard's log brought for one map, as text in ASCII: a head in a line of
its own, and JSON. A broker takes records of a limited size, so that a long one comes in parts, each with one:

    MAP_UID SHARD LSN PART PARTS

Who reads it passes over a record whose place in the log (LSN) is not after the last of its shard. A part 1
that comes again, after its sender was killed amid the parts, begins its record anew.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from semap.rules.engine.row_columns import Table, dump_rows, load_rows
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import AsItComes, Due, MapGone, RuleChanged, Step

PART_CHARACTERS = 900_000
"""A broker takes a megabyte if it says nothing else."""


@dataclass(frozen=True, slots=True)
class Head:
    """Of a part of a record; parts count from 1."""

    map_uid: str
    shard: str
    lsn: int
    part: int = 1
    parts: int = 1


@dataclass(frozen=True, slots=True)
class Handed:
    """The rules of a map are handed over as they stand; `entries` is what `MapRules` is made of."""

    map_id: int
    entries: Mapping[str, str]


def dump_record(map_uid: str, shard: str, lsn: int, steps: Iterable[Step | Handed]) -> list[str]:
    """A record of steps of one map, in as many parts as it needs."""
    text = json.dumps([_dump(step) for step in steps], separators=(",", ":"))
    parts = [text[start : start + PART_CHARACTERS] for start in range(0, len(text), PART_CHARACTERS)]
    return [f"{map_uid} {shard} {lsn} {part} {len(parts)}\n{each}" for part, each in enumerate(parts, 1)]


def split_head(text: str) -> tuple[Head, str]:
    """The head of a part, and the rest."""
    head, _, rest = text.partition("\n")
    map_uid, shard, lsn, part, parts = head.split(" ")
    return Head(map_uid, shard, int(lsn), int(part), int(parts)), rest


def load_steps(text: str) -> list[Step | Handed]:
    """The steps of a record whose parts are together."""
    return [_load(each) for each in json.loads(text)]


def _dump(step: Step | Handed) -> Sequence[object]:
    match step:
        case Due(map_id, until_us, rows):
            return "due", map_id, until_us, dump_rows(rows)
        case AsItComes(map_id, row):
            return "now", map_id, dump_rows([row])
        case RuleChanged(map_id, rule_id, rule, rows, from_us):
            begun = None if rows is None else dump_rows(rows)
            return "rule", map_id, rule_id, None if rule is None else rule.as_json(), begun, from_us
        case MapGone(map_id):
            return "gone", map_id
        case Handed(map_id, entries):
            return "handed", map_id, entries


def _load(document: Sequence[object]) -> Step | Handed:
    kind, map_id, *rest = cast(Sequence[Any], document)
    match kind, rest:
        case "due", [until_us, tables]:
            return Due(map_id, until_us, load_rows(cast(Sequence[Table], tables)))
        case "now", [tables]:
            (row,) = load_rows(cast(Sequence[Table], tables))
            return AsItComes(map_id, row)
        case "rule", [rule_id, rule, tables, from_us]:
            return RuleChanged(
                map_id,
                rule_id,
                None
                if rule is None
                else Rule.from_json(cast(int, rule_id), cast(Mapping[str, object], rule)),
                None if tables is None else load_rows(cast(Sequence[Table], tables)),
                from_us,
            )
        case "handed", [entries]:
            return Handed(map_id, cast(Mapping[str, str], entries))
        case _:
            return MapGone(map_id)
