"""Rules that the log suggests: what often follows what in one key, and soon, with the time that it takes.

A serial episode is a sequence of kinds of rows (Mannila, Toivonen, Verkamo 1997). Each occurrence takes the
first row of the next kind after the one before, as `followed by` does, so that a proposed rule finds what was
counted. Its window is the least round duration that holds most occurrences. `support` counts the first rows
that are followed so within it, `confidence` is their share of all such first rows, and `by_chance` the share
of time after which the last kind comes within that window anyhow.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil
from typing import TypeAlias

from semap.rules.condition_text import write_value
from semap.rules.declaration import Declaration
from semap.rules.engine.partition import Key, in_rooms, key_reader
from semap.rules.language.duration import UNITS_US, write_duration
from semap.rules.language.reading import parse_declaration
from semap.rules.row import Row, Source

Kind: TypeAlias = tuple[Source, str, str]
"""What the rows of an input are, its name, and their type."""

INPUTS: Mapping[Source, str] = {"relation": "query", "object_state": "object_state", "event": "rule"}

Stream: TypeAlias = Mapping[Kind, Sequence[tuple[int, int]]]
"""Of one key: the place and the stamp of each row, by kind."""

ROUND_US = [
    number * UNITS_US[unit]
    for unit, numbers in (
        ("s", (1, 2, 3, 5, 10, 15, 20, 30)),
        ("min", (1, 2, 3, 5, 10, 15, 20, 30)),
        ("h", (1, 2, 3, 6, 12)),
        ("d", (1, 2, 3, 7)),
    )
    for number in numbers
]
NO_NAME = re.compile("[^A-Za-z0-9_]+")
KEPT = 0.95
"""The share of occurrences that the window holds."""


@dataclass(frozen=True)
class Wanted:
    """Which episodes are worth a look.

    within_us   longer ones are none
    longest     kinds of rows
    lift        so many times as often as by chance
    """

    within_us: int = 5 * UNITS_US["min"]
    support: int = 5
    confidence: float = 0.5
    lift: float = 2.0
    longest: int = 3
    partitions: tuple[str, ...] = ("track", "room")


@dataclass(frozen=True)
class Proposal:
    """A rule that was not declared, and what of the log speaks for it."""

    declaration: Declaration
    kinds: tuple[Kind, ...]
    support: int
    firsts: int
    by_chance: float

    @property
    def confidence(self) -> float:
        return self.support / self.firsts


def mine(rows: Iterable[Row], wanted: Wanted) -> list[Proposal]:
    """The proposals, those that say most first: of two that say as much, the one with more support.

    rows  of any inputs, in any order
    """
    ordered = sorted(rows, key=lambda row: row.order)
    found = [each for name in wanted.partitions for each in _of_partition(ordered, name, wanted)]
    return sorted(
        found, key=lambda each: (-each.support * each.confidence, each.by_chance, each.declaration.name)
    )


def _of_partition(rows: Sequence[Row], partition_by: str, wanted: Wanted) -> list[Proposal]:
    streams = _streams(rows, partition_by)
    kinds = sorted({kind for stream in streams for kind in stream})
    span_us = max((rows[-1].own_stamp_us - rows[0].own_stamp_us) if rows else 0, 1) * max(len(streams), 1)
    frequent: list[tuple[Kind, ...]] = [(kind,) for kind in kinds]
    found = []
    for _ in range(wanted.longest - 1):
        # what is frequent begins with what is
        longer = [(*episode, kind) for episode, kind in product(frequent, kinds)]
        frequent = []
        for episode in longer:
            lengths = sorted(
                length for stream in streams for length in _lengths(stream, episode, wanted.within_us)
            )
            if len(lengths) < wanted.support:
                continue
            frequent.append(episode)
            within_us = _window_us(lengths, wanted.within_us)
            support = bisect_right(lengths, within_us - 1)
            firsts = sum(len(stream.get(episode[0], ())) for stream in streams)
            by_chance = _by_chance(streams, episode[-1], within_us, span_us)
            is_worth = support >= wanted.support and support / firsts >= wanted.confidence
            if is_worth and support / firsts >= wanted.lift * by_chance:
                declaration = _declared(episode, partition_by, within_us)
                found.append(Proposal(declaration, episode, support, firsts, by_chance))
    return found


def _streams(rows: Sequence[Row], partition_by: str) -> list[Stream]:
    key_of = key_reader([partition_by])
    streams: dict[Key, dict[Kind, list[tuple[int, int]]]] = {}
    for place, row in enumerate(rows):
        kind = row.source, str(row.values.get("input")), str(row.values.get("type"))
        for key in {key_of(each) for each in (in_rooms(row) if partition_by == "room" else (row,))} - {None}:
            assert key is not None  # noqa: S101
            streams.setdefault(key, {}).setdefault(kind, []).append((place, row.stamp_us))
    return list(streams.values())


def _lengths(stream: Stream, episode: Sequence[Kind], within_us: int) -> list[int]:
    """How long each occurrence takes, of each first row that has one [us]."""
    found = []
    for first, begin_us in stream.get(episode[0], ()):
        place, stamp_us = first, begin_us
        for kind in episode[1:]:
            later = stream.get(kind, ())
            at = bisect_right(later, place, key=lambda each: each[0])
            if at == len(later):
                break
            place, stamp_us = later[at]
        else:
            if stamp_us - begin_us < within_us:
                found.append(stamp_us - begin_us)
    return found


def _window_us(lengths: Sequence[int], most_us: int) -> int:
    """The least round duration that holds most of them; windows are exclusive."""
    needed_us = lengths[ceil(KEPT * len(lengths)) - 1] + 1
    return next((each for each in ROUND_US if needed_us <= each < most_us), most_us)


def _by_chance(streams: Sequence[Stream], kind: Kind, within_us: int, span_us: int) -> float:
    """The share of all time of all keys after which a row of the kind comes within the window."""
    covered_us = 0
    for stream in streams:
        until_us: float = float("-inf")
        for _, stamp_us in stream.get(kind, ()):
            covered_us += int(stamp_us - max(stamp_us - within_us, until_us))
            until_us = stamp_us
    return min(covered_us / span_us, 1.0)


def _declared(episode: Sequence[Kind], partition_by: str, within_us: int) -> Declaration:
    names = [chr(ord("A") + place) for place in range(len(episode))]
    event = NO_NAME.sub("_", "_then_".join(kind for *_, kind in episode))
    inputs = [{INPUTS[source]: name} for source, name in sorted({each[:2] for each in episode})]
    document = {
        "input": inputs,
        "partition_by": partition_by,
        "pattern": " followed by ".join(names),
        "define": {
            name: f"input = {write_value(source)} and type = {write_value(kind)}"
            for name, (_, source, kind) in zip(names, episode, strict=True)
        },
        "within": write_duration(within_us),
        "after_match": "skip to next row",
        "emit": event[:100],
    }
    return parse_declaration(document, f"{event}_by_{partition_by}"[:100])
