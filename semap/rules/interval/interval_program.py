"""Pairs of intervals in a relation, known as early as logic allows.

The rows of one stamp are one moment: what holds at it is known when the watermark has reached it or a later
row has come, and then the pairs of the intervals that began or ended in it are asked which relations are
still possible. When the last one that is not wanted goes, the pair is a match, at that moment. What is known
of a pair changes only when its second interval begins and when one of them ends, so a pair needs no memory of
its own: it is a match at a moment if its relation is certain at it and was not certain before.

An interval that ends in the moment in which it began has no length, and is dropped; none is paired with
itself, where one row begins an interval of both variables.

Bounds of memory: an interval is kept while it is open; after its end only where `before` or `after` is asked.
The window of a match counts from the start of the earlier interval to the moment that decides, and is
exclusive; an interval that began too long ago for it is dropped, open or not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

from semap.errors import InvalidInput
from semap.rules.bound import Condition
from semap.rules.declaration import Windows
from semap.rules.finish import Finish, finished
from semap.rules.interval.allen import APART, RELATIONS, Span, possible
from semap.rules.interval.holding import Interval, begun, subject_of
from semap.rules.program import Match
from semap.rules.row import Row
from semap.rules.row_json import dump_row, load_row


@dataclass(frozen=True, slots=True)
class IntervalState:
    """What one key remembers.

    moment_us  stamp of the latest row that began or ended an interval
    settled    whether all rows of that moment are known
    intervals  in the order in which they began
    """

    moment_us: int
    settled: bool
    intervals: tuple[Interval, ...]


@dataclass(frozen=True)
class IntervalProgram:
    """`left` in one of `relations` to `right`.

    windows     of a match; needed for before and after, which would else remember for ever
    conditions  of the two variables, asked of the row that begins an interval
    match_type  of the event that a match makes
    raises      InvalidInput for a relation that is none, and for windows that do not fit
    """

    left: str
    relations: frozenset[str]
    right: str
    windows: Windows
    conditions: Mapping[str, Condition]
    match_type: str | None
    finish: Finish

    def __post_init__(self) -> None:
        if not self.relations or not self.relations <= RELATIONS:
            raise InvalidInput(
                f"{'|'.join(sorted(self.relations - RELATIONS)) or 'nothing'} is no relation of intervals",
                f"Use one or several of {', '.join(sorted(RELATIONS))}.",
                "pattern",
            )
        if self.relations & APART and self.windows.match_us is None:
            raise InvalidInput(
                "before and after need a window, as any interval comes before those of all time to come",
                "Add one, such as within: 10 min.",
                "within",
            )
        if self.windows.step_us is not None or self.windows.variables:
            raise InvalidInput(
                "a relation of two intervals has one window, that of the match",
                "Write it as within: 10 min, or within: {match: 10 min}.",
                "within",
            )

    @cached_property
    def _variables(self) -> Mapping[str, Condition | None]:
        return {name: self.conditions.get(name) for name in (self.left, self.right)}

    def step(self, state: IntervalState | None, row: Row) -> tuple[IntervalState | None, tuple[Match, ...]]:
        """Take the next row of the key."""
        state, matches = self.advance(state, row.stamp_us - 1)
        subject = subject_of(row)
        if subject is None:
            return state, matches
        names = begun(row, self._variables)
        before = state.intervals if state is not None else ()
        intervals = tuple(
            replace(each, end=row) if each.end is None and each.subject == subject else each
            for each in before
        ) + tuple(Interval(name, row) for name in names)
        if intervals == before:
            return state, matches
        return IntervalState(row.stamp_us, False, intervals), matches

    def advance(
        self, state: IntervalState | None, watermark_us: int
    ) -> tuple[IntervalState | None, tuple[Match, ...]]:
        """Know that every row to come has a stamp after the watermark."""
        if state is None or (not state.settled and watermark_us < state.moment_us):
            return state, ()
        matches: tuple[Match, ...] = ()
        intervals = state.intervals
        if not state.settled:
            intervals = tuple(each for each in intervals if each.start_us != each.end_us)
            matches = self._decided(intervals, state.moment_us)
        kept = tuple(each for each in intervals if self._matters(each, watermark_us))
        if not kept:
            return None, matches
        if state.settled and len(kept) == len(intervals):
            return state, matches
        return IntervalState(state.moment_us, True, kept), matches

    def deadline_us(self, state: IntervalState | None) -> int | None:
        """The moment whose rows are not all known yet; else when all that is remembered may be forgotten."""
        if state is None:
            return None
        if not state.settled:
            return state.moment_us
        if self.windows.match_us is None:
            return None
        return state.intervals[-1].start_us + self.windows.match_us - 1

    def dump(self, state: IntervalState) -> object:
        """The state as JSON."""
        return {
            "moment_us": state.moment_us,
            "settled": state.settled,
            "intervals": [
                [each.variable, dump_row(each.begin), None if each.end is None else dump_row(each.end)]
                for each in state.intervals
            ],
        }

    def load(self, document: object) -> IntervalState:
        """The state that `dump` gave."""
        found = cast(Mapping[str, object], document)
        return IntervalState(
            cast(int, found["moment_us"]),
            cast(bool, found["settled"]),
            tuple(
                Interval(cast(str, variable), load_row(begin), None if end is None else load_row(end))
                for variable, begin, end in cast(Sequence[Sequence[object]], found["intervals"])
            ),
        )

    def _matters(self, interval: Interval, watermark_us: int) -> bool:
        """Whether an interval can be in a match that is decided after the watermark."""
        window_us = self.windows.match_us
        if window_us is not None and watermark_us + 1 - interval.start_us >= window_us:
            return False
        return (
            interval.end is None
            or (interval.variable == self.left and "before" in self.relations)
            or (interval.variable == self.right and "after" in self.relations)
        )

    def _decided(self, intervals: tuple[Interval, ...], moment_us: int) -> tuple[Match, ...]:
        """The pairs whose relation became certain, and is wanted, at this moment."""
        window_us = self.windows.match_us
        found: dict[tuple[tuple[int, int, str], ...], tuple[tuple[str, Row], ...]] = {}
        for left in intervals:
            if left.variable != self.left:
                continue
            for right in intervals:
                if right.variable != self.right or left.begin.order == right.begin.order:
                    continue
                start_us = min(left.start_us, right.start_us)
                if window_us is not None and moment_us - start_us >= window_us:
                    continue
                if self._became_certain(left, right, moment_us):
                    rows = _rows(left, right)
                    found[tuple(row.order for _, row in rows)] = rows
        return tuple(
            match
            for _, rows in sorted(found.items())
            for match in finished(self.match_type, rows, moment_us, self.finish)
        )

    def _became_certain(self, left: Interval, right: Interval, moment_us: int) -> bool:
        if moment_us not in (left.start_us, left.end_us, right.start_us, right.end_us):
            return False
        if not possible(_known(left, moment_us), _known(right, moment_us)) <= self.relations:
            return False
        if moment_us in (left.start_us, right.start_us):
            return True
        before = possible(_known(left, moment_us - 1), _known(right, moment_us - 1))
        return not before <= self.relations


def _known(interval: Interval, moment_us: int) -> Span:
    """The interval as far as it is known at a moment."""
    end_us = interval.end_us
    return Span(interval.start_us, None if end_us is None or end_us > moment_us else end_us)


def _rows(left: Interval, right: Interval) -> tuple[tuple[str, Row], ...]:
    """Begins and known ends, ascending; of one row that ends and begins, the end comes first."""
    placed = [
        (row.order, place, interval.variable, row)
        for interval in (left, right)
        for place, row in enumerate((interval.end, interval.begin))
        if row is not None
    ]
    placed.sort(key=lambda each: each[:2])
    return tuple((variable, row) for _, _, variable, row in placed)
