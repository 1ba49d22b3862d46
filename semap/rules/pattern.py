"""A row pattern as a value.

A match binds rows to the pattern's variables, in ascending order. A **joint** says what may stand between two
rows that are bound one after the other, and belongs to the element on its right; an optional element that
binds nothing takes its joint with it:

    next     nothing: the very next row (SQL:2016; Flink's strict contiguity)
    relaxed  anything; bound is the first later row that satisfies the element (Flink's followedBy)
    any      anything; each later row that satisfies the element makes a match of its own (followedByAny)
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

Joint = Literal["next", "relaxed", "any"]


class Excluded(str):
    """The name of a variable at a place whose rows are bound, and told of by no event."""


@dataclass(frozen=True)
class Variable:
    """Binds one row that satisfies the condition of this name; one without a condition binds any row.

    excluded  the row counts, but is not told of: `{- A -}`
    """

    name: str
    excluded: bool = False

    @property
    def label(self) -> str:
        return Excluded(self.name) if self.excluded else self.name


@dataclass(frozen=True)
class Anchor:
    """Binds nothing: the next row bound is the first of its partition, or no row of it comes any more."""

    at: Literal["begin", "end"]


@dataclass(frozen=True)
class Absent:
    """No row satisfies the condition of this name between the row bound before and the one bound after.

    The latter itself must not satisfy it either. With joint `next`, only the very next row is looked at. At
    the end of a pattern the match is complete when its window ends.
    """

    name: str


@dataclass(frozen=True)
class Element:
    """A part of a sequence, with the joint before it (of a pattern's first element it says nothing)."""

    joint: Joint
    node: Node


@dataclass(frozen=True)
class Sequence:
    """Of no elements it binds nothing: `()`."""

    elements: tuple[Element, ...]


@dataclass(frozen=True)
class Alternation:
    """One of them; the earlier ones are preferred."""

    options: tuple[Node, ...]


@dataclass(frozen=True)
class Permutation:
    """All of them in any order; the order written is preferred, then lexicographically, as in SQL:2016."""

    nodes: tuple[Node, ...]
    joint: Joint = "next"


@dataclass(frozen=True)
class Repeat:
    """least to most times (None: without end), as often as can be (greedy) or as seldom.

    joint  between two rounds
    until  no row that a round binds, or that lies between two rounds or within one, satisfies this condition
    """

    node: Node
    least: int
    most: int | None
    greedy: bool = True
    joint: Joint = "next"
    until: str | None = None


Node: TypeAlias = Variable | Absent | Anchor | Sequence | Alternation | Permutation | Repeat


def nodes_in(node: Node) -> Iterator[Node]:
    """The node and all within it."""
    yield node
    inside: Iterable[Node] = ()
    match node:
        case Sequence(elements):
            inside = (element.node for element in elements)
        case Alternation(nodes) | Permutation(nodes):
            inside = nodes
        case Repeat(inner):
            inside = (inner,)
    for each in inside:
        yield from nodes_in(each)


def has_begin(node: Node) -> bool:
    """Whether it asks which row is the first of its partition."""
    return any(isinstance(each, Anchor) and each.at == "begin" for each in nodes_in(node))
