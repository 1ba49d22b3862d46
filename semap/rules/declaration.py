"""What a rule says, read and found valid.

Four kinds of rules are told apart by their clauses: both edges of a relation (no pattern), a row pattern, a
relation between two intervals, and a formula of metric temporal logic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from semap.cql2 import Expression
from semap.rules.formula import Formula
from semap.rules.pattern import Node


@dataclass(frozen=True)
class Input:
    """What a rule reads.

    kind            None: a query of the map, else a rule, else an object's property of this name
    actor_within_m  rows get their actor: the likeliest track within this distance of the instance
    """

    name: str
    kind: Literal["query", "object_state", "map", "rule"] | None = None
    actor_within_m: float | None = None


@dataclass(frozen=True)
class Windows:
    """How far rows of one match may lie apart; each is exclusive, None is without bound.

    match_us   any row from the first
    step_us    a row from the one bound before it
    variables  the same for the rows bound to one variable
    """

    match_us: int | None = None
    step_us: int | None = None
    variables: Mapping[str, int] = field(default_factory=dict)


TOLD_AT_MOST = 1_000
"""Of the matches that end at one row, where a rule does not say how many."""

Skip: TypeAlias = Literal["none", "clear", "to next", "past last", "to first", "to last"]


@dataclass(frozen=True)
class AfterMatch:
    """Where the next match may begin.

    clear      all matches that end at one row, then none that has begun by then
    variables  to the first or last row bound to one of these
    strict     whether it is an error that there is none, or that it is the first row of the match
    at_most    so many matches are told of those that end at one row (none, clear)
    """

    skip: Skip = "past last"
    variables: frozenset[str] = frozenset()
    strict: bool = False
    at_most: int = TOLD_AT_MOST


@dataclass(frozen=True)
class Confidence:
    """How sure a match is: the share of gaps that are at least as long as its own.

    first, last  variables between whose first and last row the gap lies
    parameters   lognormal: median_s, sigma; normal: mean_s, std_s; exponential: mean_s
    at_least     a match below it makes no event
    """

    first: str
    last: str
    distribution: Literal["lognormal", "normal", "exponential"]
    parameters: Mapping[str, float]
    at_least: float = 0.0


@dataclass(frozen=True)
class Edges:
    """Each row makes the event that `emit` names for its type."""


@dataclass(frozen=True)
class RowPattern:
    """Rows in an order; `emit` names the events of a match and of a partial match that timed out."""

    node: Node


@dataclass(frozen=True)
class IntervalPattern:
    """Two intervals in one of these relations (Allen's, by CQL2's names); `emit` names the event `match`."""

    left: str
    relations: frozenset[str]
    right: str


@dataclass(frozen=True)
class TemporalFormula:
    """A formula asked whenever the variable `when` becomes true; `emit` names the events holds and fails."""

    formula: Formula
    when: str | None = None


Body: TypeAlias = Edges | RowPattern | IntervalPattern | TemporalFormula


@dataclass(frozen=True)
class Declaration:
    """A rule as it was declared.

    emit      names of events: by the type of a row (edges), else by match, timeout, holds, fails
    define    the condition of each variable
    each_row  whether each row of a match makes an event
    subsets   names for several variables each
    about     the variable whose instance an event is about; None: that of the match's last row
    document  its clauses as JSON, without the name: what is stored
    """

    name: str
    inputs: tuple[Input, ...]
    body: Body
    emit: Mapping[str, str]
    where: Expression | None = None
    partition_by: tuple[str, ...] = ()
    define: Mapping[str, Expression] = field(default_factory=dict)
    measures: Mapping[str, Expression] = field(default_factory=dict)
    within: Windows = field(default_factory=Windows)
    after_match: AfterMatch = field(default_factory=AfterMatch)
    each_row: bool = False
    subsets: Mapping[str, frozenset[str]] = field(default_factory=dict)
    about: str | None = None
    confidence: Confidence | None = None
    document: Mapping[str, object] = field(default_factory=dict)

    def as_json(self) -> Mapping[str, object]:
        """What is stored of it beside its name."""
        return self.document
