"""Propositional parts of a formula that are always or never true, whatever their atoms are."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

from semap.rules.formula import (
    Always,
    And,
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
        case Until(left, right) | Since(left, right):
            return replace(formula, left=without_tautologies(left), right=without_tautologies(right))
        case (
            Always(inner)
            | Eventually(inner)
            | Once(inner)
            | Historically(inner)
            | Previous(inner)
            | Exists(_, inner)
        ):
            return replace(formula, inner=without_tautologies(inner))
    return formula


def _is_propositional(formula: Formula) -> bool:
    return not isinstance(formula, Future | Past | Exists) and all(map(_is_propositional, parts_of(formula)))
