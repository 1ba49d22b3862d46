"""Quantified formulas, written out over the intervals that there are.

`exists L (...)` is true at a moment if some interval of L lasts then with which what stands in it is
true. That is as if one said: the first such interval lasts, and what is asked with it is true; or the
second does, and so on; or one that is not known yet. Written out so, each pair of an atom and of the
intervals of which it may ask is an atom by itself, and truth, forecasts and windows are those of formulas
without quantifiers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from semap.errors import InvalidInput
from semap.rules.bound import Bound, Condition
from semap.rules.formula import And, Atom, Constant, Exists, Formula, Not, Or, Since, Until
from semap.rules.interval.holding import satisfies
from semap.rules.row import Row
from semap.rules.temporal.metric import parts_of
from semap.rules.temporal.spans import Span, Spans, union

DEEPEST = 3
"""Quantifiers within one another, at most."""

LATER = "later"
"""An atom that is never true: so it may be, of all moments that are not known yet."""


def variables_of(formula: Formula) -> frozenset[str]:
    """The variables of its quantifiers."""
    own = {formula.name} if isinstance(formula, Exists) else set()
    return frozenset(own).union(*map(variables_of, parts_of(formula)))


def scopes(formula: Formula) -> Mapping[str, frozenset[str]]:
    """Of each atom and each quantified variable the variables of which it may ask.

    raises  InvalidInput where a variable is quantified twice or is an atom too, or quantifiers stand too deep
    """
    found: dict[str, frozenset[str]] = {}
    variables: set[str] = set()

    def gather(part: Formula, around: tuple[str, ...]) -> None:
        if isinstance(part, Atom | Exists):
            is_known = part.name in variables or (isinstance(part, Exists) and part.name in found)
            if is_known:
                raise InvalidInput(
                    f"the variable {part.name} of a quantifier stands for something else as well",
                    "Give each quantifier a variable of its own, which is no atom.",
                    "formula",
                )
            found[part.name] = found.get(part.name, frozenset(around)) & frozenset(around)
        if isinstance(part, Exists):
            variables.add(part.name)
            around = (*around, part.name)
            if len(around) > DEEPEST:
                raise InvalidInput(
                    f"more than {DEEPEST} quantifiers within one another", "Make two rules of it.", "formula"
                )
        for each in parts_of(part):
            gather(each, around)

    gather(formula, ())
    return found


def written_out(
    formula: Formula,
    asked: Bound,
    lasting: Sequence[tuple[Row, Span]],
    conditions: Mapping[str, Condition],
    signals: dict[str, Spans],
) -> Formula:
    """The formula without quantifiers; the signals of the atoms that stand for them are put into `signals`.

    asked       the row at which it is asked, with the intervals of quantifiers that stand around it
    lasting     what lasts, with the row that began it
    conditions  of quantified variables, and of atoms that ask of rows bound
    """

    def spans_of(name: str) -> Spans:
        condition = conditions[name]
        return union(span for row, span in lasting if _is_one(row, name, condition, asked))

    match formula:
        case Atom(name):
            if name not in conditions:
                return formula
            key = _key(name, asked)
            if key not in signals:
                signals[key] = spans_of(name)
            return Atom(key)
        case Constant():
            return formula
        case Exists(name, inner):
            signals[LATER] = ()
            ways: list[Formula] = [Atom(LATER)]
            for row, span in lasting:
                if not _is_one(row, name, conditions[name], asked):
                    continue
                with_it = Bound(name, row, asked)
                key = _key("", with_it)
                signals[key] = (span,)
                ways.append(And((Atom(key), written_out(inner, with_it, lasting, conditions, signals))))
            return Or(tuple(ways))
        case Not(inner):
            return Not(written_out(inner, asked, lasting, conditions, signals))
        case And(parts) | Or(parts):
            return type(formula)(
                tuple(written_out(each, asked, lasting, conditions, signals) for each in parts)
            )
        case Until(left, right) | Since(left, right):
            return replace(
                formula,
                left=written_out(left, asked, lasting, conditions, signals),
                right=written_out(right, asked, lasting, conditions, signals),
            )
        case windowed:
            return replace(windowed, inner=written_out(windowed.inner, asked, lasting, conditions, signals))


def _is_one(row: Row, name: str, condition: Condition, asked: Bound) -> bool:
    if condition.test is not None:
        return satisfies(row, name, condition)
    return condition.test_bound(row, Bound(name, row, asked))


def _key(name: str, asked: Bound) -> str:
    """An atom that is asked with these intervals; of the row at which all is asked there is one."""
    uids = [each.row.uid for each in asked.latest_first()][:-1]
    return "@".join((name, *uids))
