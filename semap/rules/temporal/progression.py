"""Progression: what is left of a formula as time goes on (Bacchus and Kabanza 1998; DyKnow).

What is asked at one moment is rewritten: a part that is decided becomes a constant, and a window loses the
part of it that is decided, so that signals matter only from `interest_us` on. Rewriting alone would need a
copy of an inner temporal operator for each microsecond of the outer one's window; these are therefore left as
they are and asked of the signals, which makes nesting exact.

For a formula in which no temporal operator stands within another, nothing but the present matters once its
windows have begun. Nested operators need the signals of their horizon; one without end within another needs
each change since the first moment that it cannot decide.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from math import inf

from semap.rules.formula import (
    Always,
    And,
    Constant,
    Eventually,
    Exists,
    Formula,
    Historically,
    Not,
    Once,
    Or,
    Previous,
    Since,
    Until,
)
from semap.rules.temporal.metric import Truth, truth_of
from semap.rules.temporal.spans import Spans, first_from, first_outside


def progressed(formula: Formula, at_us: int, atoms: Mapping[str, Truth]) -> Formula:
    """What is left to ask of a moment; a constant where nothing is."""
    truth = truth_of(formula, atoms)
    found = truth.at(at_us)
    if found is not None:
        return Constant(found)
    match formula:
        case Not(inner):
            return Not(progressed(inner, at_us, atoms))
        case And(parts):
            left = [progressed(part, at_us, atoms) for part in parts]
            return And(tuple(part for part in left if part != Constant(True)))
        case Or(parts):
            left = [progressed(part, at_us, atoms) for part in parts]
            return Or(tuple(part for part in left if part != Constant(False)))
        case Eventually(inner, least, most):
            asked = first_from(truth_of(inner, atoms).possible, at_us + least)
            return _rest(Eventually, inner, at_us, (asked, most), atoms)
        case Always(inner, least, most):
            asked = first_outside(truth_of(inner, atoms).certain, at_us + least)
            return _rest(Always, inner, at_us, (asked, most), atoms)
        case Until(left_part, right_part, least, most):
            asked = min(
                first_outside(truth_of(left_part, atoms).certain, at_us),
                first_from(truth_of(right_part, atoms).possible, at_us + least),
            )
            passed_us = int(asked) - at_us
            rest = Until(
                left_part, right_part, max(least - passed_us, 0), None if most is None else most - passed_us
            )
            return _later(rest, passed_us)
    return formula


def interest_us(formula: Formula, at_us: float, rows: Spans = ()) -> float:
    """The first moment whose atoms matter to the formula at a moment; inf if none does.

    rows  the moments at which rows came
    """
    match formula:
        case Constant():
            return inf
        case Not(inner):
            return interest_us(inner, at_us, rows)
        case Exists(_, inner):
            return min(at_us, interest_us(inner, at_us, rows))
        case And(parts) | Or(parts):
            return min((interest_us(part, at_us, rows) for part in parts), default=inf)
        case Eventually(inner, least, _) | Always(inner, least, _):
            return interest_us(inner, at_us + least, rows)
        case Until(left, right, least, _):
            return min(interest_us(left, at_us, rows), interest_us(right, at_us + least, rows))
        case Once(inner, _, most) | Historically(inner, _, most):
            return interest_us(inner, at_us - (inf if most is None else most), rows)
        case Since(left, right, _, most):
            since_us = at_us - (inf if most is None else most)
            return min(interest_us(left, since_us, rows), interest_us(right, since_us, rows))
        case Previous(inner):
            before_us = _row_before_us(at_us, rows)
            return min(before_us, interest_us(inner, before_us, rows))
    return at_us


def _row_before_us(at_us: float, rows: Spans) -> float:
    """The last moment before one at which a row came; itself where none did."""
    place = bisect_left(rows, (at_us, -inf))
    return rows[place - 1][0] if place else at_us


def _rest(
    operator: type[Eventually] | type[Always],
    inner: Formula,
    at_us: int,
    window: tuple[float, int | None],
    atoms: Mapping[str, Truth],
) -> Formula:
    """The operator over what is left of its window; over a single moment it only says when to ask."""
    least, to_us = int(window[0]) - at_us, window[1]
    if least == to_us:
        return _later(progressed(inner, at_us + least, atoms), least)
    return operator(inner, least, to_us)


def _later(formula: Formula, after_us: int) -> Formula:
    """The formula asked so much later."""
    if isinstance(formula, Eventually) and formula.from_us == formula.to_us:
        return Eventually(formula.inner, formula.from_us + after_us, formula.from_us + after_us)
    return Eventually(formula, after_us, after_us) if after_us else formula
