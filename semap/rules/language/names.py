"""The variables of a rule, as its pattern or formula uses them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from operator import or_

from semap.rules.declaration import Body, Edges, IntervalPattern, RowPattern, TemporalFormula
from semap.rules.pattern import Absent, Alternation, Anchor, Node, Permutation, Repeat, Sequence, Variable
from semap.rules.temporal.metric import atom_names


@dataclass(frozen=True)
class Names:
    """Variables.

    bound   that rows are bound to
    absent  whose condition no row may satisfy
    ending  whose condition ends a repetition
    """

    bound: frozenset[str] = frozenset()
    absent: frozenset[str] = frozenset()
    ending: frozenset[str] = frozenset()

    @property
    def all(self) -> frozenset[str]:
        return self.bound | self.absent | self.ending

    def __or__(self, other: Names) -> Names:
        return Names(self.bound | other.bound, self.absent | other.absent, self.ending | other.ending)


def names_of(body: Body) -> Names:
    """The variables of a rule of any kind; both edges of a relation have none."""
    match body:
        case Edges():
            return Names()
        case RowPattern(node):
            return _names_in(node)
        case IntervalPattern(left, _, right):
            return Names(bound=frozenset({left, right}))
        case TemporalFormula(formula, when):
            return Names(bound=frozenset(atom_names(formula)) | ({when} if when else frozenset()))


def _names_in(node: Node) -> Names:
    inside: Iterable[Node]
    match node:
        case Variable(name):
            return Names(bound=frozenset({name}))
        case Absent(name):
            return Names(absent=frozenset({name}))
        case Anchor():
            return Names()
        case Repeat(node=inner, until=until):
            return _names_in(inner) | Names(ending=frozenset({until} if until is not None else ()))
        case Sequence(elements):
            inside = (element.node for element in elements)
        case Alternation(options):
            inside = options
        case Permutation(nodes):
            inside = nodes
    return reduce(or_, map(_names_in, inside), Names())
