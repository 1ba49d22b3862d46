"""A filter as a value: a tree that says what is asked, and nothing of where it is evaluated.

`place` is where a part stood in the filter, for messages; it does not count in a comparison.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from typing import TypeAlias

import shapely


@dataclass(frozen=True)
class Property:
    """A property of the thing that is asked about."""

    name: str
    place: str = field(default="", compare=False)


@dataclass(frozen=True)
class Literal:
    """A text, a number, a truth value or null."""

    value: str | float | bool | None
    place: str = field(default="", compare=False)


@dataclass(frozen=True)
class Instant:
    """A moment, aware; a date is its first moment in UTC."""

    stamp: datetime
    place: str = field(default="", compare=False)


@dataclass(frozen=True)
class Interval:
    """From a moment to a moment, both included; None is without an end on that side."""

    start: Instant | Property | Call | None
    end: Instant | Property | Call | None
    place: str = field(default="", compare=False)


@dataclass(frozen=True)
class Shape:
    """A geometry seen from above [m, map frame]."""

    geometry: shapely.Geometry
    place: str = field(default="", compare=False)


@dataclass(frozen=True)
class Array:
    """A list of parts."""

    items: tuple[Expression, ...]
    place: str = field(default="", compare=False)


@dataclass(frozen=True)
class Call:
    """An operator or function, by the name that CQL2-JSON gives it, with what it is applied to."""

    op: str
    args: tuple[Expression, ...]
    place: str = field(default="", compare=False)


Expression: TypeAlias = Property | Literal | Instant | Interval | Shape | Array | Call


def parts(expression: Expression) -> Iterator[Expression]:
    """The expression and everything in it, outermost first."""
    yield expression
    match expression:
        case Call(args=inner) | Array(items=inner):
            for each in inner:
                yield from parts(each)
        case Interval(start=start, end=end):
            for side in (start, end):
                if side is not None:
                    yield from parts(side)
