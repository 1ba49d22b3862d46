"""How much of the past a rule needs, to find what it would have found had it run all along."""

from __future__ import annotations

from collections.abc import Iterable
from math import inf

from semap.rules.declaration import Declaration, IntervalPattern, RowPattern, TemporalFormula
from semap.rules.temporal.metric import back_us, horizon_us


def lookback_us(declarations: Iterable[Declaration]) -> float:
    """So long before an event may the first row be that it rests on [us]; inf where there is no bound.

    Of rules that read each other's events: together.
    """
    known = {declaration.name: declaration for declaration in declarations}
    return max((_with_inputs(declaration, known) for declaration in known.values()), default=0)


def _with_inputs(declaration: Declaration, known: dict[str, Declaration]) -> float:
    read = (known[item.name] for item in declaration.inputs if item.name in known)
    return _alone_us(declaration) + max((_with_inputs(each, known) for each in read), default=0)


def _alone_us(declaration: Declaration) -> float:
    match declaration.body:
        case RowPattern() | IntervalPattern():
            match_us = declaration.within.match_us
            return inf if match_us is None else match_us
        case TemporalFormula(formula=formula):
            return horizon_us(formula) + back_us(formula)
    return 0
