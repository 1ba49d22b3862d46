"""What was found against what was so: which of it belongs together, what was missed, what was made up."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment


@dataclass(frozen=True)
class Occurrence:
    """Something of a kind happened at a place: a person entered a room, a door opened.

    until_us  of what took time, such as the turning of a leaf: its end; it was at any moment in between
    """

    kind: str
    place: str
    stamp_us: int
    until_us: int | None = None

    def error_us(self, stamp_us: int) -> int:
        """How far a stamp is from when it was; negative: too early."""
        until_us = self.stamp_us if self.until_us is None else self.until_us
        return min(stamp_us - self.stamp_us, 0) + max(stamp_us - until_us, 0)


@dataclass(frozen=True)
class Scores:
    """matched  pairs of a label and what was found of it"""

    matched: tuple[tuple[Occurrence, Occurrence], ...]
    missed: tuple[Occurrence, ...]
    made_up: tuple[Occurrence, ...]

    @property
    def recall(self) -> float:
        """Of the labels; 1 where there are none."""
        labels = len(self.matched) + len(self.missed)
        return len(self.matched) / labels if labels else 1.0

    @property
    def precision(self) -> float:
        """Of what was found; 1 where nothing was."""
        found = len(self.matched) + len(self.made_up)
        return len(self.matched) / found if found else 1.0

    @property
    def errors_ms(self) -> list[float]:
        """Found less label, in event time."""
        return [label.error_us(found.stamp_us) / 1e3 for label, found in self.matched]


def match(labels: Iterable[Occurrence], found: Iterable[Occurrence], tolerance_us: int) -> Scores:
    """Pair each label with at most one finding of its kind and place, at most the tolerance away.

    As many pairs as can be; of those pairings the one with the least error in all.
    """
    labelled, seen = _by_what(labels), _by_what(found)
    matched: list[tuple[Occurrence, Occurrence]] = []
    missed: list[Occurrence] = []
    made_up: list[Occurrence] = []
    for what in labelled.keys() | seen.keys():
        wanted, given = labelled.get(what, []), seen.get(what, [])
        pairs = _pair(wanted, given, tolerance_us)
        matched += [(wanted[row], given[column]) for row, column in pairs]
        missed += [each for i, each in enumerate(wanted) if i not in {row for row, _ in pairs}]
        made_up += [each for i, each in enumerate(given) if i not in {column for _, column in pairs}]
    return Scores(
        tuple(sorted(matched, key=lambda pair: _order(pair[0]))),
        tuple(sorted(missed, key=_order)),
        tuple(sorted(made_up, key=_order)),
    )


def together(scores: Iterable[Scores]) -> Scores:
    """Several recordings as one."""
    every = list(scores)
    return Scores(
        tuple(pair for each in every for pair in each.matched),
        tuple(one for each in every for one in each.missed),
        tuple(one for each in every for one in each.made_up),
    )


def _by_what(occurrences: Iterable[Occurrence]) -> dict[tuple[str, str], list[Occurrence]]:
    grouped: dict[tuple[str, str], list[Occurrence]] = defaultdict(list)
    for each in sorted(occurrences, key=_order):
        grouped[each.kind, each.place].append(each)
    return grouped


def _pair(
    wanted: Sequence[Occurrence], given: Sequence[Occurrence], tolerance_us: int
) -> list[tuple[int, int]]:
    if not wanted or not given:
        return []
    error = np.abs([[label.error_us(found.stamp_us) for found in given] for label in wanted])
    # a pair that is not allowed costs more than all that are, so that as many as can be are paired
    forbidden = float(tolerance_us) * (min(error.shape) + 1) + 1
    rows, columns = linear_sum_assignment(np.where(error <= tolerance_us, error, forbidden))
    return [
        (int(row), int(column))
        for row, column in zip(rows, columns, strict=True)
        if error[row, column] <= tolerance_us
    ]


def _order(occurrence: Occurrence) -> tuple[int, str, str]:
    return occurrence.stamp_us, occurrence.kind, occurrence.place
