"""The rows that a match has bound so far: a chain of values, the latest first."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

from semap.rules.row import Row

NO_VARIABLE = ""
"""What the row is bound to at which an empty match stands."""


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


class Asked(NamedTuple):
    """The first or the last row that is bound to one of the variables (None: any), or rows so far from it."""

    end: Literal["first", "last"]
    variables: frozenset[str] | None
    offset: int

    def rows(self, bound: Bound) -> tuple[int, ...]:
        """The identities of these rows and of those between it and that end, the latest first."""
        among = self.variables
        found = [id(each.row) for each in bound.latest_first() if among is None or each.variable in among]
        return tuple(found[: self.offset + 1] if self.end == "last" else found[-self.offset - 1 :])


@dataclass(frozen=True)
class Condition:
    """A condition in CQL2, compiled.

    test           whether it is true of a row, by the row alone; None where it reads more than that
    test_bound     the same with the rows bound so far; where the row is about to be bound, it is the head
    reads          properties of rows that it reads
    asked          which of the rows bound it asks, of which variables; None: it may ask all
    """

    test: Callable[[Row], bool] | None
    test_bound: Callable[[Row, Bound | None], bool]
    reads: frozenset[str] = frozenset()
    asked: frozenset[Asked] | None = None
