"""What every kind of rule is once compiled: an automaton that is frozen, to which its state is handed.

`step` and `advance` are its only inputs. A state belongs to one key of one rule; None is the state of a key
that has seen nothing, or all of which has been pruned.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from semap.rules.row import Row, Value

State = Any
"""Known only to the program that made it."""


@dataclass(slots=True)
class Match:
    """What a program found. A value, though not frozen, which would make it three times as dear.

    type      of the event that it makes
    stamp_us  event time of what was found: its last row, or the moment at which its absence was certain
    rows      the rows bound, ascending, each with its variable
    measures  by name; instants are RFC 3339 texts, so that all of it is JSON
    identity  what tells it from another match of its type and rows; empty where there is none
    """

    type: str
    stamp_us: int
    rows: tuple[tuple[str, Row], ...]
    measures: Mapping[str, Value] = field(default_factory=dict)
    confidence: float | None = None
    identity: str = ""


class Program(Protocol):
    """A compiled rule. A state that was stepped or advanced is spent."""

    def step(self, state: State | None, row: Row) -> tuple[State | None, tuple[Match, ...]]:
        """Take the next row of a key; all rows of that key before it have been taken."""
        ...

    def advance(self, state: State | None, watermark_us: int) -> tuple[State | None, tuple[Match, ...]]:
        """Know that every row to come has a stamp after the watermark."""
        ...

    def deadline_us(self, state: State | None) -> int | None:
        """The earliest watermark at which `advance` has something to do."""
        ...

    def dump(self, state: State) -> object:
        """The state as JSON."""
        ...

    def load(self, document: object) -> State:
        """The state that `dump` gave."""
        ...


class LossyProgram(Program, Protocol):
    """One that says what it did not tell; both lists are to be cleared by whoever reads them.

    given_up  the first rows of attempts that were given up because there were too many
    untold    how many matches were not told, each time with the first row of the earliest
    """

    given_up: list[Row]
    untold: list[tuple[Row, int]]
