"""The rows that a match has bound so far: a chain of values, the latest first."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from semap.rules.row import Row


@dataclass(slots=True, unsafe_hash=True)
class Bound:
    """A row bound to a variable, and what was bound before it.

    A value, though not frozen: that is three times as dear to make, and each row bound makes one.
    """

    variable: str
    row: Row
    before: Bound | None = None

    def latest_first(self) -> Iterator[Bound]:
        bound: Bound | None = self
        while bound is not None:
            yield bound
            bound = bound.before


def chained(rows: Iterable[tuple[str, Row]]) -> Bound | None:
    """The chain of rows with their variables, ascending; None of no row."""
    bound: Bound | None = None
    for variable, row in rows:
        bound = Bound(variable, row, bound)
    return bound


@dataclass(frozen=True)
class Condition:
    """A condition in CQL2, compiled.

    test           whether it is true of a row, by the row alone; None where it reads more than that
    test_bound     the same with the rows bound so far and the row before it in its key (None: none known).
                   Where the row is about to be bound, it is the head of the chain
    reads          properties of rows that it reads
    reads_before   whether it reads the row before (prev)
    """

    test: Callable[[Row], bool] | None
    test_bound: Callable[[Row, Bound | None, Row | None], bool]
    reads: frozenset[str] = frozenset()
    reads_before: bool = False
