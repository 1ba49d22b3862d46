"""Metric temporal logic over signals that become known: verdicts as early as they are certain.

Time is whole microseconds, and an atom is true or false throughout each. At a moment `known_us` the atoms are
known of all moments before it, and of none from it on. A formula's **truth** is then three-valued at each
moment, and kept as two sets: where it is certainly true, and where it is possibly so. `not` swaps and
complements them; every other operator is monotone and takes each set by itself (Kleene's logic; the temporal
operators are the greatest and least value of a window).

A verdict comes at the first moment at which it is certain, for a formula in which no temporal operator stands
within another and no atom under two of them, once `tautology` has been through it. Others are
true or false at the first moment at which Kleene's logic says so; that can be later where parts that are
unknown would balance each other, as in `eventually[0, 1 s] p or always[0, 1 s] not p`. The verdict itself is
exact however operators are nested, and never changes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from math import inf
from types import UnionType
from typing import TypeAlias

from semap.rules.formula import (
    Always,
    And,
    Atom,
    Constant,
    Eventually,
    Exists,
    Formula,
    Future,
    Historically,
    Not,
    Once,
    Or,
    Past,
    Previous,
    Since,
    Until,
)
from semap.rules.temporal.spans import (
    EVERYWHERE,
    NOWHERE,
    Spans,
    after,
    before,
    clipped,
    complement,
    first_outside,
    holds,
    intersection,
    union,
)

Signals: TypeAlias = Mapping[str, Spans]
"""When each atom is true; one that is true now is so until inf."""

ROWS = ""
"""Stands among atoms for the moments at which rows came, where a formula asks for them."""


@dataclass(frozen=True, slots=True)
class Truth:
    """Where something is certainly and where it is possibly true."""

    certain: Spans
    possible: Spans

    def at(self, moment: float) -> bool | None:
        """None: unknown."""
        if holds(self.certain, moment):
            return True
        return None if holds(self.possible, moment) else False


def known_until(signals: Signals, known_us: float) -> dict[str, Truth]:
    """The truth of the atoms of which all before this moment is known, and no more."""
    truths = {}
    for name, spans in signals.items():
        certain = clipped(spans, -inf, known_us)
        truths[name] = Truth(certain, union([*certain, (known_us, inf)]))
    return truths


def truth_of(formula: Formula, atoms: Mapping[str, Truth]) -> Truth:
    """Where the formula is true."""
    match formula:
        case Atom() | Exists():
            return atoms[name_of(formula)]
        case Constant(value):
            return Truth(EVERYWHERE, EVERYWHERE) if value else Truth(NOWHERE, NOWHERE)
        case Not(inner):
            truth = truth_of(inner, atoms)
            return Truth(complement(truth.possible), complement(truth.certain))
        case And(parts):
            truths = [truth_of(part, atoms) for part in parts]
            return Truth(
                reduce(intersection, (truth.certain for truth in truths), EVERYWHERE),
                reduce(intersection, (truth.possible for truth in truths), EVERYWHERE),
            )
        case Or(parts):
            truths = [truth_of(part, atoms) for part in parts]
            return Truth(
                union(span for truth in truths for span in truth.certain),
                union(span for truth in truths for span in truth.possible),
            )
        case Eventually(inner, least, most):
            truth = truth_of(inner, atoms)
            return Truth(before(truth.certain, least, _end(most)), before(truth.possible, least, _end(most)))
        case Always(inner, least, most):
            truth = truth_of(inner, atoms)
            return Truth(
                _throughout(truth.certain, least, _end(most)), _throughout(truth.possible, least, _end(most))
            )
        case Until(left, right, least, most):
            one, other = truth_of(left, atoms), truth_of(right, atoms)
            return Truth(
                _until(one.certain, other.certain, least, _end(most)),
                _until(one.possible, other.possible, least, _end(most)),
            )
        case Once(inner, least, most):
            truth = truth_of(inner, atoms)
            return Truth(after(truth.certain, least, _end(most)), after(truth.possible, least, _end(most)))
        case Historically(inner, least, most):
            truth = truth_of(inner, atoms)
            certain, possible = (
                complement(after(complement(spans), least, _end(most)))
                for spans in (truth.certain, truth.possible)
            )
            return Truth(certain, possible)
        case Since(left, right, least, most):
            one, other = truth_of(left, atoms), truth_of(right, atoms)
            return Truth(
                _since(one.certain, other.certain, least, _end(most)),
                _since(one.possible, other.possible, least, _end(most)),
            )
        case Previous(inner, least, most):
            return _previous(truth_of(inner, atoms), atoms[ROWS], least, _end(most))


def verdict(formula: Formula, at_us: int, signals: Signals, known_us: int) -> bool | None:
    """Whether the formula is true at a moment, with the atoms known before another; None: not certain."""
    return truth_of(formula, known_until(signals, known_us)).at(at_us)


def parts_of(formula: Formula) -> tuple[Formula, ...]:
    """What the formula is made of, as written."""
    match formula:
        case Not(inner) | Eventually(inner) | Always(inner):
            return (inner,)
        case Once(inner) | Historically(inner) | Previous(inner) | Exists(_, inner):
            return (inner,)
        case And(parts) | Or(parts):
            return parts
        case Until(left, right) | Since(left, right):
            return left, right
    return ()


def name_of(formula: Atom | Exists) -> str:
    """By which it stands among atoms, where what is quantified has a truth of its own."""
    return formula.name if isinstance(formula, Atom) else repr(formula)


def quantified(formula: Formula) -> tuple[Exists, ...]:
    """The quantified formulas in it that stand within no other."""
    if isinstance(formula, Exists):
        return (formula,)
    return tuple(each for part in parts_of(formula) for each in quantified(part))


def has_previous(formula: Formula) -> bool:
    """Whether it asks at which moments rows came."""
    return isinstance(formula, Previous) or any(map(has_previous, parts_of(formula)))


def atom_names(formula: Formula) -> tuple[str, ...]:
    """The atoms, and the variables of quantifiers, in the order in which they are written."""
    if isinstance(formula, Atom):
        return (formula.name,)
    own = (formula.name,) if isinstance(formula, Exists) else ()
    inside = (name for part in parts_of(formula) for name in atom_names(part))
    return tuple(dict.fromkeys((*own, *inside)))


def horizon_us(formula: Formula) -> float:
    """So far ahead does a formula look [us]."""
    return _reach_us(formula, Future)


def back_us(formula: Formula) -> float:
    """So far back does a formula look, from any moment that it asks for [us]."""
    return _reach_us(formula, Past)


def _reach_us(formula: Formula, kind: UnionType) -> float:
    own_us: float = 0
    if isinstance(formula, Future | Past) and isinstance(formula, kind):
        own_us = inf if formula.to_us is None else formula.to_us
    return own_us + max((_reach_us(part, kind) for part in parts_of(formula)), default=0)


def _end(to_us: int | None) -> float:
    return inf if to_us is None else to_us


def _throughout(spans: Spans, least: float, most: float) -> Spans:
    """The moments from which on all of the window lies in these spans."""
    return complement(before(complement(spans), least, most))


def _until(left: Spans, right: Spans, least: float, most: float) -> Spans:
    """The moments with one of `right` in the window and all before that one in `left`."""
    found = list(right) if least == 0 else []
    for start, end in left:
        reached = before(clipped(right, start, end + 1), least, most)
        found.extend(clipped(reached, start, end))
    return union(found)


def _since(left: Spans, right: Spans, least: float, most: float) -> Spans:
    """The moments with one of `right` in the past window and all after that one in `left`."""
    found = list(right) if least == 0 else []
    for start, end in left:
        reached = after(clipped(right, start - 1, end), least, most)
        found.extend(clipped(reached, start, end))
    return union(found)


def _previous(inner: Truth, rows: Truth, least: float, most: float) -> Truth:
    """The moments so long after the last row before them, at which it was true."""
    known_us = next((first_outside(rows.certain, start) for start, end in rows.possible if end == inf), inf)
    came = [moment for start, end in rows.certain for moment in range(int(start), int(end))]

    def held(spans: Spans) -> Spans:
        return union(
            (moment + max(least, 1), min(moment + most, until) + 1)
            for moment, until in zip(came, [*came[1:], known_us], strict=True)
            if holds(spans, moment)
        )

    return Truth(held(inner.certain), union([*held(inner.possible), (known_us + 1, inf)]))
