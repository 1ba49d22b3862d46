"""Metric temporal logic that looks back, against a plain evaluation microsecond by microsecond."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, Protocol

from hypothesis import given, settings
from hypothesis import strategies as st
from rules.interval_rows import new_state, run, run_by_deadlines, said
from rules.test_formula_program import END, P, Q, bounds, program

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
from semap.rules.temporal.formula_json import dump_formula, load_formula
from semap.rules.temporal.metric import back_us, horizon_us, parts_of

FIRST, LAST = 40, 100
"""Nothing is true before FIRST; no formula here looks farther than from there to the ends of the grid."""


class World(Protocol):
    """The moments of each atom; and of each interval of a variable, with the world where that is bound to it."""

    def __getitem__(self, name: str, /) -> set[int]: ...

    def ways(self, name: str) -> Iterable[tuple[set[int], World]]: ...


def holds(formula: Formula, at: int, true: dict[str, set[int]] | World, rows: set[int]) -> bool:
    """By the definitions, moment by moment; `rows` has the moments of rows."""
    if not 0 <= at <= LAST:
        at = max(min(at, LAST), 0)
    inner = parts_of(formula)

    def ask(place: int, moment: int) -> bool:
        return holds(inner[place], moment, true, rows)

    match formula:
        case Atom(name):
            return at in true[name]
        case Constant(value):
            return value
        case Exists(name):
            assert not isinstance(true, dict)
            return any(at in of and holds(inner[0], at, world, rows) for of, world in true.ways(name))
        case Not():
            return not ask(0, at)
        case And():
            return all(ask(place, at) for place in range(len(inner)))
        case Or():
            return any(ask(place, at) for place in range(len(inner)))
    ahead = not isinstance(formula, Once | Historically | Since | Previous)
    most = LAST + 1 if formula.to_us is None else formula.to_us
    window = [at + by if ahead else at - by for by in range(formula.from_us, most + 1)]
    window = [moment for moment in window if 0 <= moment <= LAST] or [LAST if ahead else 0]
    match formula:
        case Eventually() | Once():
            return any(ask(0, moment) for moment in window)
        case Always() | Historically():
            return all(ask(0, moment) for moment in window)
        case Until():
            return any(
                ask(1, moment) and all(ask(0, each) for each in range(at, moment)) for moment in window
            )
        case Since():
            return any(
                ask(1, moment) and all(ask(0, each) for each in range(moment + 1, at + 1))
                for moment in window
            )
    last = max((moment for moment in rows if moment < at), default=None)
    return last is not None and last in window and ask(0, last)


OF_ONE = (Once, Historically, Previous, Once, Historically, Eventually, Always)


def formulas(unbounded: bool) -> st.SearchStrategy[Formula]:
    def larger(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
        windows = bounds(4, unbounded)
        return (
            st.builds(lambda kind, one, window: kind(one, *window), st.sampled_from(OF_ONE), inner, windows)
            | st.builds(
                lambda kind, one, two, window: kind(one, two, *window),
                st.sampled_from((Since, Since, Until)), inner, inner, windows,
            )
            | inner.map(Not)
            | st.tuples(inner, inner).map(And)
            | st.tuples(inner, inner).map(Or)
        )  # fmt: skip

    found = st.recursive(st.sampled_from([P, Q, P, Q, Constant(True)]), larger, max_leaves=4)
    return found.filter(lambda formula: back_us(formula) > 0 and horizon_us(formula) <= 12)


toggling = st.fixed_dictionaries({name: st.sets(st.integers(FIRST, FIRST + 17), max_size=6) for name in "PQ"})
asking = st.sets(st.integers(FIRST, FIRST + 20), min_size=1, max_size=3)


def rows_of(toggles: dict[str, set[int]], starts: set[int]) -> list[Any]:
    rows = [
        new_state(moment, name.lower(), "off" if place % 2 else "on")
        for name, moments in toggles.items()
        for place, moment in enumerate(sorted(moments))
    ]
    return sorted([*rows, *(new_state(at, "start", "asked") for at in starts)], key=lambda row: row.order)


def true_of(toggles: dict[str, set[int]]) -> dict[str, set[int]]:
    return {
        name: {at for at in range(LAST + 1) if sum(1 for each in moments if each <= at) % 2}
        for name, moments in toggles.items()
    }


@settings(max_examples=300, deadline=None)
@given(formulas(False), toggling, asking)
def test_what_was_is_as_the_definitions_say(
    formula: Formula, toggles: dict[str, set[int]], starts: set[int]
) -> None:
    rows = rows_of(toggles, starts)
    _, found = run(program(formula), rows, END)
    moments = {row.stamp_us for row in rows}
    wanted = {at: holds(formula, at, true_of(toggles), moments) for at in starts}
    assert {match.rows[0][1].stamp_us: match.type == "holds" for match in found} == wanted
    for match in found:
        begun = match.rows[0][1].stamp_us
        assert begun <= match.stamp_us <= begun + horizon_us(formula)


@settings(max_examples=200, deadline=None)
@given(formulas(True), toggling, asking, st.sets(st.integers(0, 90)), st.sampled_from(["S", "P", None]))
def test_no_cut_and_no_watermark_changes_what_is_found(
    formula: Formula, toggles: dict[str, set[int]], starts: set[int], advances: set[int], when: str | None
) -> None:
    asked = program(formula, when)
    rows = rows_of(toggles, starts)
    _, whole = run(asked, rows, END)
    _, in_pieces = run(asked, rows, END, advances, stored=True)
    assert said(in_pieces) == said(whole)
    _, announced = run_by_deadlines(asked, rows, END)
    assert said(match for _, match in announced) == said(whole)


@settings(max_examples=100, deadline=None)
@given(formulas(True))
def test_formulas_that_look_back_are_stored(formula: Formula) -> None:
    assert load_formula(json.loads(json.dumps(dump_formula(formula)))) == formula


def test_without_a_bound_only_what_is_asked_for_is_kept() -> None:
    """`previous` needs the last row; once without a bound needs all changes; with one, none older."""
    for formula, most in ((Previous(P), 4), (Once(P, 0, 10), 10)):
        asked, state = program(formula), None
        for moment in range(0, 2000, 5):
            state, _ = asked.step(state, new_state(moment, "p", "on" if moment % 10 else "off"))
            state, _ = asked.advance(state, moment)
            assert state is None or sum(len(spans) for spans in state.signals.values()) <= most


def test_a_key_is_forgotten_once_nothing_of_it_can_be_asked_for() -> None:
    asked = program(Once(P, 0, 10))
    state, _ = asked.step(None, new_state(0, "p", "on"))
    state, _ = asked.step(state, new_state(3, "p", "off"))
    assert asked.deadline_us(state) == 13
    assert asked.advance(state, 12)[0] is state
    assert asked.advance(state, 13) == (None, ())
