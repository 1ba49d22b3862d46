"""A row pattern as a value.

A match binds rows to the pattern's variables, in ascending order. A **joint** says what may stand between two
rows that are bound one after the other, and belongs to the element on its right; an optional element that
binds nothing takes its joint with it:

    next     nothing: the very next row (SQL:2016; Flink's strict contiguity)
    relaxed  anything; bound is the first later row that satisfies the element (Flink's followedBy)
    any      anything; each later row that satisfies the element makes a match of its own (followedByAny)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Joint = Literal["next", "relaxed", "any"]


@dataclass(frozen=True)
class Variable:
    """Binds one row that satisfies the condition of this name; one without a condition binds any row."""

    name: str


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


Node: TypeAlias = Variable | Absent | Sequence | Alternation | Permutation | Repeat
