"""What is under way in one key: attempts, each all the runs that began with one row, the preferred first.

Runs, attempts and endings are values; they are not declared frozen because that makes them three times as
dear, and a row makes several.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from semap.rules.bound import Bound
from semap.rules.matching.automaton import Outlook
from semap.rules.row import Row


@dataclass(slots=True)
class Run:
    """A candidate so far: the rows bound, and what may come next.

    deadline_us  when time alone changes it
    """

    outlook: Outlook
    bound: Bound
    deadline_us: int


@dataclass(slots=True)
class TimedOut:
    """The partial match of an attempt of which a window ended the last run."""

    bound: Bound
    stamp_us: int


@dataclass(slots=True)
class Attempt:
    """The runs that began with one row; without runs it is over.

    found  whether there was a match (told only where all matches are wanted)
    """

    first: Row
    runs: tuple[Run, ...]
    deadline_us: int
    found: bool = False
    timed_out: TimedOut | None = None


class Underway(Protocol):
    """An attempt, whether it is worked out or not."""

    @property
    def first(self) -> Row: ...

    @property
    def runs(self) -> tuple[Run, ...]: ...

    @property
    def timed_out(self) -> TimedOut | None: ...


@dataclass(slots=True)
class Ending:
    """A match, or a partial match that timed out."""

    stamp_us: int
    first: Row
    bound: Bound
    is_match: bool = True


def is_over(attempt: Underway) -> bool:
    """Whether it is certain what becomes of it, but for earlier attempts that could skip it."""
    return not attempt.runs or attempt.runs[0].outlook.final is not None


def ends_with(attempt: Attempt, row: Row) -> bool:
    """Whether it has its match, with this as the last row."""
    return bool(attempt.runs) and is_over(attempt) and attempt.runs[0].bound.row is row


def length(bound: Bound) -> int:
    """How many rows are bound."""
    return sum(1 for _ in bound.latest_first())


def first_row(bound: Bound) -> Row:
    """The first row bound."""
    while bound.before is not None:
        bound = bound.before
    return bound.row


def path(bound: Bound) -> tuple[tuple[str, Row], ...]:
    """The rows bound, ascending."""
    rows = []
    each: Bound | None = bound
    while each is not None:
        rows.append((each.variable, each.row))
        each = each.before
    return tuple(reversed(rows))
