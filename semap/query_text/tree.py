"""A query's text as values: what is left of SQL once all that a continuous query cannot say is refused.

`at` is where a part begins in the text [characters]. Names are in lower case unless they were quoted.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias


@dataclass(frozen=True)
class Column:
    """A name with or without the table it is of; `*` for all columns."""

    table: str | None
    name: str
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Property:
    """A column that is known: `name` in the view of a side (0 or 1)."""

    side: int
    name: str
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Row:
    """A side as a whole, as an argument of a function."""

    side: int
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Constant:
    """A text, a number, a truth value or null."""

    value: str | int | float | bool | None
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Call:
    """An operator: its symbol, or and, or, not, in, like, ilike, between, is null, collate."""

    op: str
    args: tuple[Expression, ...]
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Function:
    """A function by its name, without its schema."""

    name: str
    args: tuple[Expression, ...]
    at: int = field(default=0, compare=False)


@dataclass(frozen=True)
class Cast:
    """A value as another type, by the name that PostgreSQL gives the type."""

    type: str
    inner: Expression
    at: int = field(default=0, compare=False)


Expression: TypeAlias = Column | Property | Row | Constant | Call | Function | Cast


@dataclass(frozen=True)
class Output:
    """One of what is selected, with the name that AS gives it."""

    expression: Expression
    alias: str | None
    at: int = 0


@dataclass(frozen=True)
class Table:
    """A view in FROM, and what it is called there."""

    name: str
    alias: str
    at: int = 0


@dataclass(frozen=True)
class Subquery:
    """A SELECT in FROM, and what it is called there."""

    select: Select
    alias: str
    lateral: bool
    at: int = 0


Range: TypeAlias = Table | Subquery


@dataclass(frozen=True)
class Select:
    """A SELECT: what must be true is a list, of which all has to be."""

    outputs: tuple[Output, ...]
    ranges: tuple[Range, ...]
    conditions: tuple[Expression, ...]
    order: Expression | None
    limit: Constant | None
    at: int = 0


def inner_of(expression: Expression) -> tuple[Expression, ...]:
    """What a part is made of."""
    match expression:
        case Call(args=args) | Function(args=args):
            return args
        case Cast(inner=inner):
            return (inner,)
    return ()


def parts(expression: Expression) -> Iterator[Expression]:
    """The expression and all in it, outermost first."""
    yield expression
    for each in inner_of(expression):
        yield from parts(each)
