"""A row pattern that asks for more of its partition than the rows of a match: what stands around it.

Before the pattern's own program takes a row, the row is told what `prev`, `next` and `^` want to know; where
`next` does, it waits for as many rows, or for the end of the window. After it, matches are numbered, and rows
that are in none are found: a row is in none as soon as no attempt is left that began with it or before.

Memory of a key is what the program itself has, the rows that wait, and as many behind as `prev` asks for
within the window. A rule with `^` or `match_number()` remembers each key for good, by a number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

from semap.rules.bound import NO_VARIABLE
from semap.rules.matching.attempt import Ending
from semap.rules.matching.automaton import FOREVER_US
from semap.rules.matching.neighbours import Neighbours
from semap.rules.matching.telling import UNMATCHED, Telling
from semap.rules.program import LossyProgram, Match, State
from semap.rules.row import Row
from semap.rules.row_json import dump_row, load_row


@dataclass(slots=True)
class Surrounded:
    """What one key remembers. A value, though not frozen, which would make it three times as dear.

    inner    of the pattern's own program
    begun    whether it has had a row, where that matters
    number   of matches so far, where that matters
    behind   rows taken, the latest last
    waiting  rows that wait for those after them
    open     rows taken of which it is not certain whether a match has them
    matched  which of these one has, by uid
    """

    inner: State | None = None
    begun: bool = False
    number: int = 0
    behind: tuple[Row, ...] = ()
    waiting: tuple[Row, ...] = ()
    open: tuple[Row, ...] = ()
    matched: frozenset[str] = frozenset()


NOTHING = Surrounded()


@dataclass(frozen=True)
class SurroundedProgram:
    """Implements `Program`.

    program     tells its endings raw
    is_counted  whether matches are numbered
    """

    program: LossyProgram
    neighbours: Neighbours
    telling: Telling
    is_counted: bool
    given_up: list[Row] = field(init=False, compare=False)
    untold: list[tuple[Row, int]] = field(init=False, compare=False)

    _ahead: int = field(init=False, repr=False)
    _behind: int = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_ahead", self.neighbours.ahead)
        object.__setattr__(self, "_behind", self.neighbours.behind)
        object.__setattr__(self, "given_up", self.program.given_up)
        object.__setattr__(self, "untold", self.program.untold)

    def step(self, state: Surrounded | None, row: Row) -> tuple[Surrounded | None, tuple[Match, ...]]:
        known = state or NOTHING
        if not self._ahead:
            return self._taken(known, row, ())
        return self._released(replace(known, waiting=(*known.waiting, row)), row.stamp_us)

    def advance(
        self, state: Surrounded | None, watermark_us: int
    ) -> tuple[Surrounded | None, tuple[Match, ...]]:
        if state is None:
            return None, ()
        is_over = watermark_us >= FOREVER_US
        left, matches = self._released(state, 2 * FOREVER_US if is_over else watermark_us + 1)
        known = left or NOTHING
        until_us = min([watermark_us, *(row.stamp_us - 1 for row in known.waiting[:1])])
        inner, ends = self.program.advance(known.inner, until_us)
        behind = () if is_over else self._near(known.behind, watermark_us + 1)
        known = replace(known, inner=inner, behind=behind)
        after, more = self._told(known, cast("tuple[Ending, ...]", ends))
        return (None if is_over else after), (*matches, *more)

    def deadline_us(self, state: Surrounded | None) -> int | None:
        if state is None:
            return None
        found = [row.stamp_us + self.neighbours.window_us for row in (*state.waiting[:1], *state.behind[:1])]
        inner_us = self.program.deadline_us(state.inner)
        if inner_us is not None and (not state.waiting or inner_us < state.waiting[0].stamp_us):
            found.append(inner_us + 1)
        earliest_us = min(found, default=FOREVER_US)
        return earliest_us - 1 if earliest_us < FOREVER_US else None

    def dump(self, state: Surrounded) -> object:
        return {
            "inner": None if state.inner is None else self.program.dump(state.inner),
            "begun": state.begun,
            "number": state.number,
            "behind": [dump_row(row) for row in state.behind],
            "waiting": [dump_row(row) for row in state.waiting],
            "open": [dump_row(row) for row in state.open],
            "matched": sorted(state.matched),
        }

    def load(self, document: object) -> Surrounded:
        stored = cast("dict[str, Any]", document)
        inner = stored["inner"]
        return Surrounded(
            None if inner is None else self.program.load(inner),
            stored["begun"],
            stored["number"],
            behind=tuple(map(load_row, stored["behind"])),
            waiting=tuple(map(load_row, stored["waiting"])),
            open=tuple(map(load_row, stored["open"])),
            matched=frozenset(stored["matched"]),
        )

    def _released(self, state: Surrounded, now_us: int) -> tuple[Surrounded | None, tuple[Match, ...]]:
        """The state with those rows taken that wait for nothing any more: all of before now have come."""
        matches: list[Match] = []
        left: Surrounded | None = state
        while left is not None and left.waiting and self._is_ready(left.waiting, now_us):
            raw, *ahead = left.waiting
            left, new = self._taken(left, raw, tuple(ahead))
            matches += new
        return left, tuple(matches)

    def _is_ready(self, waiting: Sequence[Row], now_us: int) -> bool:
        neighbours = self.neighbours
        return len(waiting) > self._ahead or now_us - waiting[0].stamp_us >= neighbours.window_us

    def _taken(
        self, state: Surrounded, raw: Row, ahead: tuple[Row, ...]
    ) -> tuple[Surrounded | None, tuple[Match, ...]]:
        """The state after a row, with those after it that wait."""
        behind = self._near(state.behind, raw.stamp_us) if self._behind else ()
        row = self.neighbours.told(raw, behind, ahead, begins=not state.begun)
        inner, ends = self.program.step(state.inner, row)
        kept = (*behind, raw)[-self._behind :] if self._behind else ()
        open_ = (*state.open, row) if self.telling.emits.unmatched is not None else ()
        after = Surrounded(inner, self.neighbours.begins, state.number, kept, ahead, open_, state.matched)
        return self._told(after, cast("tuple[Ending, ...]", ends))

    def _near(self, behind: Sequence[Row], now_us: int) -> tuple[Row, ...]:
        return tuple(row for row in behind if now_us - row.stamp_us < self.neighbours.window_us)

    def _told(
        self, state: Surrounded, ends: tuple[Ending, ...]
    ) -> tuple[Surrounded | None, tuple[Match, ...]]:
        """What is kept of a new state, and what its endings are told as."""
        matches: tuple[Match, ...] = ()
        if ends:
            numbered = []
            for end in sorted(ends, key=lambda each: each.first.order):
                state.number += end.is_match and self.is_counted
                numbered.append((state.number, end))
            matches = self.telling.numbered(numbered)
        if state.open:
            matched = state.matched.union(row.uid for end in ends if end.is_match for row in _rows(end))
            state.open, unmatched = self._decided(state, matched)
            state.matched = matched & {row.uid for row in state.open}
            matches = (*unmatched, *matches)
        is_kept = state.begun or state.number or state.behind or state.waiting or state.open
        return state if is_kept or state.inner is not None else None, matches

    def _decided(self, state: Surrounded, matched: frozenset[str]) -> tuple[tuple[Row, ...], list[Match]]:
        """The rows that are still open, and those that are in no match."""
        attempts = state.inner.attempts if state.inner is not None else ()
        left, decided = state.open, 0
        while decided < len(left) and not (attempts and attempts[0].first.order <= left[decided].order):
            decided += 1
        event_type = self.telling.emits.unmatched
        lone = [row for row in left[:decided] if row.uid not in matched] if event_type else []
        return left[decided:], [
            Match(str(event_type), row.stamp_us, ((NO_VARIABLE, row),), identity=UNMATCHED) for row in lone
        ]


def _rows(end: Ending) -> list[Row]:
    return [bound.row for bound in end.bound.latest_first()]
