"""Formulas as JSON, a list of the operator's name and its parts: what is left of one is stored in a state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

from semap.rules.formula import (
    Always,
    And,
    Atom,
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

OF_ONE: dict[str, type[Eventually | Always | Once | Historically | Previous]] = {
    "eventually": Eventually,
    "always": Always,
    "once": Once,
    "historically": Historically,
    "previous": Previous,
}
OF_TWO: dict[str, type[Until | Since]] = {"until": Until, "since": Since}


def dump_formula(formula: Formula) -> list[object]:
    """The formula as JSON."""
    match formula:
        case Atom(name):
            return ["atom", name]
        case Constant(value):
            return ["constant", value]
        case Not(inner):
            return ["not", dump_formula(inner)]
        case Exists(name, inner):
            return ["exists", name, dump_formula(inner)]
        case And(parts):
            return ["and", *map(dump_formula, parts)]
        case Or(parts):
            return ["or", *map(dump_formula, parts)]
        case Until(left, right, least, most) | Since(left, right, least, most):
            return [type(formula).__name__.lower(), least, most, dump_formula(left), dump_formula(right)]
    return [type(formula).__name__.lower(), formula.from_us, formula.to_us, dump_formula(formula.inner)]


def load_formula(document: object) -> Formula:
    """The formula that `dump_formula` gave."""
    operator, *parts = cast(Sequence[object], document)
    match operator:
        case "atom":
            return Atom(cast(str, parts[0]))
        case "constant":
            return Constant(cast(bool, parts[0]))
        case "not":
            return Not(load_formula(parts[0]))
        case "exists":
            return Exists(cast(str, parts[0]), load_formula(parts[1]))
        case "and":
            return And(tuple(map(load_formula, parts)))
        case "or":
            return Or(tuple(map(load_formula, parts)))
    least, most = cast(int, parts[0]), cast("int | None", parts[1])
    inner = [load_formula(part) for part in parts[2:]]
    if operator in ("until", "since"):
        return OF_TWO[operator](inner[0], inner[1], least, most)
    return OF_ONE[cast(str, operator)](inner[0], least, most)
