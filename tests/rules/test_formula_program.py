"""Metric temporal logic, against a plain evaluation microsecond by microsecond."""

import json
from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rules.interval_rows import new_state, nothing_measured, relation, run, run_by_deadlines, said, where

from semap.rules.formula import Always, And, Atom, Constant, Eventually, Not, Or, Until
from semap.rules.temporal import formula_program
from semap.rules.temporal.forecast import forecast
from semap.rules.temporal.formula_json import dump_formula, load_formula
from semap.rules.temporal.formula_program import FormulaProgram
from semap.rules.temporal.metric import atom_names, parts_of, verdict
from semap.rules.temporal.tautology import without_tautologies

P, Q = Atom("P"), Atom("Q")
LAST = 60
END = 10**6
FALSE, UNKNOWN, TRUE = 0, 1, 2

CONDITIONS = {
    "P": where(of="p", type="on"),
    "Q": where(of="q", type="on"),
    "S": where(of="start"),
}


def program(formula, when="S", finish=nothing_measured):
    return FormulaProgram(formula, when, CONDITIONS, {"holds": "holds", "fails": "fails"}, finish)


# --- the oracle: three values, on the grid 0 .. LAST ------------------------------------------------------


def value(formula, at, grid):
    """The formula at a moment; `grid` has the value of each atom at each moment."""
    return on_grid(formula, grid)[at]


def on_grid(formula, grid):
    """The formula at each moment, by the definitions."""
    moments = range(LAST + 1)
    inner = [on_grid(part, grid) for part in parts_of(formula)]
    match formula:
        case Atom(name):
            return grid[name]
        case Constant(constant):
            return [TRUE if constant else FALSE for _ in moments]
        case Not():
            return [TRUE - inner[0][at] for at in moments]
        case And():
            return [min((part[at] for part in inner), default=TRUE) for at in moments]
        case Or():
            return [max((part[at] for part in inner), default=FALSE) for at in moments]
        case Always():
            return [min(inner[0][s] for s in window(formula, at)) for at in moments]
        case Eventually():
            return [max(inner[0][s] for s in window(formula, at)) for at in moments]
        case Until():
            left, right = inner
            return [max(min([right[s], *left[at:s]]) for s in window(formula, at)) for at in moments]


def window(formula, at):
    """Beyond the grid everything is as it is at its end."""
    to = LAST if formula.to_us is None else at + formula.to_us
    return sorted({min(s, LAST) for s in range(at + formula.from_us, to + 1)} or {LAST})


def grid_of(signals, known):
    """The atoms' values of which those before `known` are known."""
    return {
        name: [UNKNOWN if at >= known else TRUE if on else FALSE for at, on in enumerate(values)]
        for name, values in signals.items()
    }


def first_certain(formula, at, signals):
    """(moment, verdict) at which Kleene's logic first is certain, or None."""
    for moment in range(at, LAST - 25):
        found = value(formula, at, grid_of(signals, moment + 1))
        if found != UNKNOWN:
            return moment, found == TRUE
    return None


def first_without_a_future_against_it(formula, at, signals, horizon):
    """(moment, verdict) at which all futures agree."""
    names = sorted(signals)
    for moment in range(at, at + horizon + 1):
        free = range(moment + 1, at + horizon + 1)
        verdicts = set()
        for future in product((TRUE, FALSE), repeat=len(free) * len(names)):
            grid = grid_of(signals, moment + 1)
            for (name, when), on in zip(product(names, free), future, strict=True):
                grid[name][when] = on
            verdicts.add(value(formula, at, grid))
            if len(verdicts) > 1:
                break
        if len(verdicts) == 1:
            return moment, verdicts == {TRUE}
    raise AssertionError("a formula is decided at its horizon")


# --- hypothesis -------------------------------------------------------------------------------------------


def bounds(most, unbounded):
    ends = st.integers(0, most)
    return st.tuples(ends, st.none() | ends if unbounded else ends).map(
        lambda pair: pair if pair[1] is None else (min(pair), max(pair))
    )


def propositions():
    return st.recursive(
        st.sampled_from([P, Q]),
        lambda inner: inner.map(Not) | st.tuples(inner, inner).map(And) | st.tuples(inner, inner).map(Or),
        max_leaves=3,
    )


def temporals(inner, windows):
    return (
        st.builds(lambda one, window: Eventually(one, *window), inner, windows)
        | st.builds(lambda one, window: Always(one, *window), inner, windows)
        | st.builds(lambda one, two, window: Until(one, two, *window), inner, inner, windows)
    )


def unnested():
    """A temporal operator over propositions, or two that share no atom."""
    over_p, over_q = (
        temporals(st.sampled_from([atom, Not(atom), Or((atom, Not(atom)))]), bounds(3, False))
        for atom in (P, Q)
    )
    pairs = st.tuples(over_p, over_q)
    return temporals(propositions(), bounds(4, False)) | pairs.map(And) | pairs.map(Or)


def formulas(unbounded=False):
    """Any formula whose bounds add up to less than what the grid leaves them; many have nested operators."""

    def larger(inner):
        temporal = temporals(inner, bounds(4, unbounded))
        joined = st.tuples(inner, inner).map(And) | st.tuples(inner, inner).map(Or)
        return st.one_of(temporal, temporal, joined, inner.map(Not))

    leaves = st.sampled_from([P, Q, P, Q, P, Q, Constant(True)])
    return temporals(st.recursive(leaves, larger, max_leaves=4), bounds(4, unbounded)).filter(
        lambda formula: reach(formula) <= 16
    )


def reach(formula):
    own = getattr(formula, "to_us", 0)
    own = getattr(formula, "from_us", 0) if own is None else own
    return own + max((reach(part) for part in parts_of(formula)), default=0)


def signals_of(toggles):
    """The atoms on the grid, changed at these moments."""
    return {
        name: [bool(sum(1 for each in moments if each <= at) % 2) for at in range(LAST + 1)]
        for name, moments in toggles.items()
    }


def rows_of(toggles, starts):
    rows = [
        new_state(moment, name.lower(), "off" if place % 2 else "on")
        for name, moments in toggles.items()
        for place, moment in enumerate(sorted(moments))
    ]
    rows += [new_state(moment, "start", "asked") for moment in starts]
    return sorted(rows, key=lambda row: row.order)


toggling = st.fixed_dictionaries({name: st.sets(st.integers(0, 17), max_size=6) for name in "PQ"})


@settings(max_examples=250, deadline=None)
@given(formulas(unbounded=True), toggling, st.integers(0, 10))
def test_verdicts_are_exact_and_come_as_early_as_kleene_says(formula, toggles, at):
    _, found = run(program(formula), rows_of(toggles, [at]), LAST - 26)
    signals = signals_of(toggles)
    simple = without_tautologies(formula)
    wanted = first_certain(simple, at, signals)
    assert [(match.stamp_us, match.type == "holds") for match in found] == (
        [] if wanted is None else [wanted]
    )
    if simple != formula and (plain := first_certain(formula, at, signals)) is not None:
        assert wanted is not None
        assert (wanted[0] <= plain[0], wanted[1]) == (True, plain[1])


@settings(max_examples=300, deadline=None)
@given(formulas(), toggling, st.integers(0, 10))
def test_a_formula_with_bounds_is_decided_by_its_horizon_as_all_of_the_signals_say(formula, toggles, at):
    state, found = run(program(formula), rows_of(toggles, [at]), END)
    ((stamp_us, verdict_given),) = [(match.stamp_us, match.type == "holds") for match in found]
    whole = value(formula, at, grid_of(signals_of(toggles), LAST + 1))
    assert verdict_given == (whole == TRUE)
    assert at <= stamp_us <= at + reach(formula)
    held = {name for name, values in signals_of(toggles).items() if values[LAST]} & set(atom_names(formula))
    assert (state is None) == (not held)


@settings(max_examples=150, deadline=None)
@given(unnested(), toggling, st.integers(0, 3))
def test_without_nesting_no_verdict_is_later_than_the_last_future_against_it(formula, toggles, at):
    toggles = {name: {moment for moment in moments if moment < 8} for name, moments in toggles.items()}
    _, found = run(program(formula), rows_of(toggles, [at]), END)
    wanted = first_without_a_future_against_it(formula, at, signals_of(toggles), reach(formula))
    assert [(match.stamp_us, match.type == "holds") for match in found] == [wanted]


@settings(max_examples=200, deadline=None)
@given(
    formulas(unbounded=True),
    toggling,
    st.sets(st.integers(0, 17), max_size=4),
    st.sets(st.integers(-1, 40)),
    st.sampled_from(["S", "P", None]),
)
def test_no_cut_and_no_watermark_changes_what_is_found(formula, toggles, starts, advances, when):
    asked = program(formula, when)
    rows = rows_of(toggles, starts)
    _, whole = run(asked, rows, END)
    _, in_pieces = run(asked, rows, END, advances, stored=True)
    assert said(in_pieces) == said(whole)
    _, announced = run_by_deadlines(asked, rows, END)
    assert said(match for _, match in announced) == said(whole)
    assert [given_us for given_us, _ in announced] == [match.stamp_us for match in whole]


@settings(max_examples=200, deadline=None)
@given(formulas(unbounded=True))
def test_formulas_are_stored(formula):
    assert load_formula(json.loads(json.dumps(dump_formula(formula)))) == formula


# --- by hand ----------------------------------------------------------------------------------------------

SECOND = 1_000_000


def test_eventually_is_true_when_it_begins_and_false_when_its_time_is_over():
    formula = Eventually(P, 0, 6 * SECOND)
    start = new_state(0, "start", "asked")
    on = new_state(6 * SECOND, "p", "on")
    _, found = run(program(formula), [start, on], 100 * SECOND)
    assert said(found) == [("holds", 6 * SECOND, [("S", start.uid), ("P", on.uid)])]
    late = new_state(6 * SECOND + 1, "p", "on")
    _, found = run(program(formula), [start, late], 100 * SECOND)
    assert said(found) == [("fails", 6 * SECOND, [("S", start.uid)])]


def test_always_is_false_at_once():
    on, start, off = new_state(0, "p", "on"), new_state(5, "start", "asked"), new_state(9, "p", "off")
    _, found = run(program(Always(P, 0, 100)), [on, start, off], END)
    assert said(found) == [("fails", 9, [("S", start.uid), ("P", off.uid)])]


def test_a_row_that_changes_something_else_when_time_is_over_did_not_decide():
    start, other = new_state(0, "start", "asked"), new_state(6, "q", "on")
    formula = And((Eventually(P, 0, 6), Eventually(Q, 0, 9)))
    _, found = run(program(formula), [start, other], END)
    assert said(found) == [("fails", 6, [("S", start.uid)])]


def test_when_is_asked_of_any_row_unless_it_is_an_atom():
    ended = where(of="in_room", type="ended")
    rows = [relation(1, "began", "in_room"), relation(2, "ended", "in_room"), new_state(4, "p", "on")]
    asked = FormulaProgram(
        Eventually(P, 0, 3), "L", {"L": ended, "P": CONDITIONS["P"]}, {"holds": "yes"}, nothing_measured
    )
    assert said(run(asked, rows, END)[1]) == [("yes", 4, [("L", rows[1].uid), ("P", rows[2].uid)])]
    inside = FormulaProgram(
        Until(Atom("L"), P),
        "L",
        {"L": where(of="in_room"), "P": CONDITIONS["P"]},
        {"fails": "no"},
        nothing_measured,
    )
    assert said(run(inside, rows, END)[1]) == [("no", 2, [("L", rows[0].uid), ("L", rows[1].uid)])]


def test_without_when_the_next_evaluation_begins_at_the_row_after_a_verdict():
    rows = [
        new_state(moment, "p", kind) for moment, kind in ((0, "on"), (10, "off"), (30, "on"), (70, "off"))
    ]
    _, found = run(program(Always(P, 0, 20), None), rows, END)
    assert said(found) == [
        ("fails", 10, [("", rows[0].uid), ("P", rows[1].uid)]),
        ("holds", 50, [("", rows[2].uid)]),
        ("fails", 70, [("", rows[3].uid)]),
    ]


def test_response_holds_for_ever_or_fails_in_time():
    """Whenever P, within 5 Q: the verdict can only be that it failed, and no past is kept for it."""
    asked = program(Always(Or((Not(P), Eventually(Q, 0, 5)))))
    state, _ = asked.step(None, new_state(0, "start", "asked"))
    for cycle in range(1, 300):
        base = 20 * cycle
        for row in (
            new_state(base, "p", "on"),
            new_state(base + 1, "p", "off"),
            new_state(base + 5, "q", "on"),
            new_state(base + 6, "q", "off"),
        ):
            state, matches = asked.step(state, row)
            assert matches == ()
            assert sum(len(spans) for spans in state.signals.values()) <= 4
    row = new_state(9000, "p", "on")
    state, _ = asked.step(state, row)
    assert asked.advance(state, 9004)[1] == ()
    _, matches = asked.advance(state, 9005)
    assert said(matches) == [("fails", 9005, [("S", "start-1-asked-0")])]


@pytest.mark.parametrize("formula", [Always(Or((P, Q))), Until(Or((P, Q)), And((P, Q)))])
def test_without_nesting_only_the_present_is_kept(formula):
    asked = program(formula)
    state, _ = asked.step(None, new_state(0, "p", "on"))
    state, _ = asked.step(state, new_state(0, "start", "asked"))
    for moment in range(1, 400):
        name = "q" if moment % 4 in (1, 2) else "p"
        state, matches = asked.step(state, new_state(2 * moment, name, "on"))
        assert matches == () or isinstance(formula, Until)
        if isinstance(formula, Until):
            break
        other = "p" if name == "q" else "q"
        state, _ = asked.step(state, new_state(2 * moment + 1, other, "off"))
        assert sum(len(spans) for spans in state.signals.values()) <= 3


def test_what_is_never_decided_is_given_up_from_a_bound_on(monkeypatch):
    monkeypatch.setattr(formula_program, "MOST_EVALUATIONS", 3)
    asked = program(Always(Not(P)))
    state = None
    for moment in range(5):
        state, _ = asked.step(state, new_state(moment, "start", "asked"))
    assert [row.stamp_us for row in asked.given_up] == [0, 1]
    assert len(state.evaluations) == 3
    _, found = run(asked, [new_state(moment, "start", "asked") for moment in range(5)], END)
    assert found == []
    assert asked.deadline_us(state) == 4


def test_kleene_is_late_where_unknowns_balance_each_other():
    formula = Or((Eventually(P, 0, 5), Always(Not(P), 0, 5)))
    found = forecast(formula, 0, {"P": ()}, 1)
    assert (found.verdict, found.certain_us) == (True, 5)
    assert verdict(Or((P, Not(P))), 0, {"P": ()}, 0) is None
    assert without_tautologies(Eventually(Or((P, Not(P))), 3, 4)) == Eventually(Constant(True), 3, 4)


def test_finish_measures_or_drops_a_verdict():
    rows = [new_state(0, "start", "asked"), new_state(3, "p", "on")]
    measured = program(
        Eventually(P), finish=lambda last, stamp_us: ({"stamp": stamp_us, "by": last.variable}, 0.25)
    )
    _, (match,) = run(measured, rows, END)
    assert (match.measures, match.confidence) == ({"stamp": 3, "by": "P"}, 0.25)
    state, found = run(program(Eventually(P), finish=lambda last, stamp_us: None), rows, END)
    assert found == []
    assert state.evaluations == ()
