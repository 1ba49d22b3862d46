"""What a row makes of all that is under way in a key, remembered.

Where conditions ask the row alone and windows count from the first row, what a step does follows from the
outlooks of the runs, which are the **shape** of the key, and from the answers to the conditions; the rows
only fill it in. So each step is taken once in the general way, which defines it, and what it did is
remembered as a **turn**: which runs are there afterwards, and whence each has its rows. Together they are a
finite automaton with registers, built as it is needed (as in V. Laurikari, NFAs with tagged transitions and
their conversion to deterministic automata, 2000).

What depends on more than that is not remembered, and is taken in the general way each time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from semap.rules.bound import Bound
from semap.rules.matching.attempt import Attempt, Ending, Run, is_over
from semap.rules.matching.automaton import Automaton, Finish, Outlook
from semap.rules.row import Row

RUNS_AT_MOST = 8
SHAPES_AT_MOST = 1_000
TURNS_AT_MOST = 1_000
"""Beyond these, what is under way is too manifold for the same to come again."""

THE_ROW = -1

Origin: TypeAlias = tuple[int, str | None]
"""Of a chain of rows: the run that had it, by number (THE_ROW: none), and what the row is bound to, if so."""


@dataclass(slots=True)
class Turn:
    """What a row with certain answers does.

    shape   afterwards; None: nothing is under way any more
    firsts  whence each attempt has its first row: from an attempt before, by number, or it is THE_ROW
    bounds  whence each run has its rows
    end     whence the match has its rows, if there is one
    """

    shape: Shape | None
    firsts: tuple[int, ...]
    bounds: tuple[Origin, ...]
    end: Origin | None
    begins: str | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        # what most rows do that do anything, and twice as fast by itself
        if self.firsts == (THE_ROW,) and len(self.bounds) == 1:
            self.begins = self.bounds[0][1]

    def after(self, before: Brief, row: Row) -> Brief | None:
        """The state after the row."""
        shape = self.shape
        if shape is None:
            return None
        if self.begins is not None:
            bound = Bound(self.begins, row)
            return Brief(shape, (row,), (bound,), row.stamp_us + shape.match_us)
        firsts = tuple([before.firsts[place] if place >= 0 else row for place in self.firsts])
        bounds = tuple([chain(origin, before, row) for origin in self.bounds])
        return Brief(shape, firsts, bounds, firsts[0].stamp_us + shape.match_us)


UNKNOWN = Turn(None, (), (), None)
"""Not remembered."""


def chain(origin: Origin, before: Brief, row: Row) -> Bound:
    """The rows of that origin."""
    place, variable = origin
    if variable is None:
        return before.bounds[place]
    return Bound(variable, row, before.bounds[place] if place >= 0 else None)


class Shape:
    """Where the runs of a key stand, by attempt, the preferred first.

    is_silent  whether nothing is found when windows end
    turns      by the answers; None where nothing changes
    """

    __slots__ = ("_tests", "is_silent", "match_us", "outlooks", "turns")

    def __init__(
        self,
        outlooks: tuple[tuple[Outlook, ...], ...],
        tests: tuple[tuple[int, Callable[[Row], bool]], ...],
        match_us: int,
        *,
        times_out: bool,
    ) -> None:
        self.outlooks = outlooks
        may_end = any(
            isinstance(choice, Finish) for runs in outlooks for run in runs for choice in run.choices
        )
        self.is_silent = not times_out and not may_end
        self._tests = tests
        self.match_us = match_us
        self.turns: dict[int, Turn | None] = {}

    def answers(self, row: Row) -> int:
        """What the conditions of outlooks say of a row, a bit for each."""
        answers = 0
        for bit, test in self._tests:
            if test(row):
                answers |= bit
        return answers

    def remember(self, row: Row, turn: Turn | None) -> None:
        """What the row did is what all such rows do."""
        if len(self.turns) < TURNS_AT_MOST:
            self.turns[self.answers(row)] = turn


@dataclass(slots=True)
class Brief:
    """A `PatternState` by its shape, whose runs are all still open.

    firsts  the first row of each attempt
    bounds  what each run has bound, attempt by attempt
    """

    shape: Shape
    firsts: tuple[Row, ...]
    bounds: tuple[Bound, ...]
    deadline_us: int

    @property
    def attempts(self) -> tuple[Attempt, ...]:
        found = []
        place = 0
        for outlooks, first in zip(self.shape.outlooks, self.firsts, strict=True):
            deadline_us = first.stamp_us + self.shape.match_us
            runs = tuple(
                Run(outlook, self.bounds[number], deadline_us)
                for number, outlook in enumerate(outlooks, place)
            )
            place += len(runs)
            found.append(Attempt(first, runs, deadline_us))
        return tuple(found)


class Shapes:
    """All that is remembered for one program, of which every match skips past its last row or nothing."""

    def __init__(self, automaton: Automaton, *, times_out: bool) -> None:
        self._match_us = automaton.match_us
        self._start = automaton.start
        self._times_out = times_out
        self._shapes: dict[tuple[tuple[Outlook, ...], ...], Shape] = {}
        self.none = Brief(self._shape(()), (), (), 2**64)

    def brief(self, attempts: Sequence[Attempt]) -> Brief | None:
        """The state of these attempts by its shape; None where it is not to be remembered."""
        if len(attempts) > RUNS_AT_MOST:
            return None
        bounds = tuple([run.bound for attempt in attempts for run in attempt.runs])
        # which runs of an attempt are one depends on how long they are, where the longest is to time out
        if len(bounds) > (len(attempts) if self._times_out else RUNS_AT_MOST):
            return None
        if any(map(is_over, attempts)) or len(set(map(id, bounds))) < len(bounds):
            return None  # runs that share their rows here need not do so elsewhere
        shape = self._known(tuple(tuple(run.outlook for run in attempt.runs) for attempt in attempts))
        if shape is None:
            return None
        firsts = tuple(attempt.first for attempt in attempts)
        return Brief(shape, firsts, bounds, firsts[0].stamp_us + self._match_us)

    def left(self, brief: Brief, now_us: int) -> Brief | None:
        """The state without attempts whose windows have ended; None where that may find something."""
        if not brief.shape.is_silent:
            return None
        firsts, outlooks = brief.firsts, brief.shape.outlooks
        over = runs = 0
        while over < len(firsts) and now_us - firsts[over].stamp_us >= self._match_us:
            runs += len(outlooks[over])
            over += 1
        if over == len(firsts):
            return self.none
        shape = self._known(outlooks[over:])
        if shape is None:
            return None
        return Brief(shape, firsts[over:], brief.bounds[runs:], firsts[over].stamp_us + self._match_us)

    def _known(self, outlooks: tuple[tuple[Outlook, ...], ...]) -> Shape | None:
        """The shape of these; None where there are too many."""
        shape = self._shapes.get(outlooks)
        if shape is None and len(self._shapes) < SHAPES_AT_MOST:
            shape = self._shape(outlooks)
        return shape

    def _shape(self, outlooks: tuple[tuple[Outlook, ...], ...]) -> Shape:
        tests = dict(
            test for each in (*outlooks, (self._start,)) for outlook in each for test in outlook.simple
        )
        made = self._shapes[outlooks] = Shape(
            outlooks, tuple(tests.items()), self._match_us, times_out=self._times_out
        )
        return made


def turn_of(before: Brief, row: Row, after: Brief | None, ends: Sequence[Ending]) -> Turn | None:
    """What the row did; None where it could do something else with other rows and the same answers."""
    if len(ends) > 1:
        return None
    if ends and ends[0].bound.row is not row and len(before.firsts) > 1:
        return None  # which attempts a match skips that ended before this row depends on their rows
    of_chain = {id(bound): number for number, bound in enumerate(before.bounds)}
    of_chain[id(None)] = THE_ROW

    def origin(bound: Bound) -> Origin:
        known = of_chain.get(id(bound))
        return (of_chain[id(bound.before)], bound.variable) if known is None else (known, None)

    bounds = tuple(map(origin, after.bounds)) if after is not None else ()
    if len(set(bounds)) < len(bounds):
        return None
    of_first = {id(first): number for number, first in enumerate(before.firsts)}
    return Turn(
        after.shape if after is not None else None,
        tuple(of_first.get(id(first), THE_ROW) for first in after.firsts) if after is not None else (),
        bounds,
        origin(ends[0].bound) if ends else None,
    )
