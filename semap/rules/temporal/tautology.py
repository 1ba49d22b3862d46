"""Propositional parts of a formula that are always or never true, whatever their atoms are."""

from __future__ import annotations

from itertools import product

from semap.rules.formula import Always, And, Constant, Eventually, Formula, Not, Or, Until
from semap.rules.temporal.metric import atom_names, parts_of, verdict
from semap.rules.temporal.spans import EVERYWHERE, NOWHERE

MOST_ATOMS = 8
"""A part with more is left as it is: it gives the same verdicts, perhaps later."""


def without_tautologies(formula: Formula) -> Formula:
    """The same with each propositional part that is always or never true replaced by that constant."""
    names = atom_names(formula)
    if _is_propositional(formula):
        if len(names) > MOST_ATOMS:
            return formula
        rows = (
            dict(zip(names, row, strict=True)) for row in product((NOWHERE, EVERYWHERE), repeat=len(names))
        )
        values = {verdict(formula, 0, row, 1) for row in rows}
        return Constant(values == {True}) if len(values) == 1 else formula
    match formula:
        case Not(inner):
            return Not(without_tautologies(inner))
        case And(parts):
            return And(tuple(without_tautologies(part) for part in parts))
        case Or(parts):
            return Or(tuple(without_tautologies(part) for part in parts))
        case Eventually(inner, least, most):
            return Eventually(without_tautologies(inner), least, most)
        case Always(inner, least, most):
            return Always(without_tautologies(inner), least, most)
        case Until(left, right, least, most):
            return Until(without_tautologies(left), without_tautologies(right), least, most)
    return formula


def _is_propositional(formula: Formula) -> bool:
    return not isinstance(formula, Eventually | Always | Until) and all(
        map(_is_propositional, parts_of(formula))
    )
