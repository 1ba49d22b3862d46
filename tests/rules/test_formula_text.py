"""The text of formulas, and of durations: what each form says, every formula has a text, mistakes are placed."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from semap.errors import InvalidInput
from semap.rules.formula import Always, And, Atom, Constant, Eventually, Formula, Not, Or, Until
from semap.rules.language import formula_text
from semap.rules.language.duration import LONGEST_US, read_duration, write_duration

P, Q, R = Atom("P"), Atom("Q"), Atom("R")
S = 1_000_000

SAID = {
    "P": P,
    "true": Constant(True),
    "not false": Not(Constant(False)),
    "P and Q and R": And((P, Q, R)),
    "(P and Q) and R": And((And((P, Q)), R)),
    "P or Q and R": Or((P, And((Q, R)))),
    "(P or Q) and R": And((Or((P, Q)), R)),
    "P implies Q": Or((Not(P), Q)),
    "P implies Q implies R": Or((Not(P), Or((Not(Q), R)))),
    "P or Q implies R": Or((Not(Or((P, Q))), R)),
    "not P and Q": And((Not(P), Q)),
    "always P": Always(P),
    "always[0 s, 6 s] P": Always(P, 0, 6 * S),
    "always[0, 6 s] P": Always(P, 0, 6 * S),
    "always [ 1.5 , 6 ] P": Always(P, 1_500_000, 6 * S),
    "eventually[500 ms, 5 min] not P": Eventually(Not(P), 500_000, 300 * S),
    "eventually[6 s, inf] P and Q": And((Eventually(P, 6 * S), Q)),
    "eventually[0s,0s] P": Eventually(P, 0, 0),
    "eventually always P": Eventually(Always(P)),
    "P until Q": Until(P, Q),
    "P until[0 s, 6 s] Q and R": And((Until(P, Q, 0, 6 * S), R)),
    "not P until always Q": Until(Not(P), Always(Q)),
    "P until (Q until R)": Until(P, Until(Q, R)),
}


@pytest.mark.parametrize(("text", "formula"), SAID.items())
def test_each_form_says_what_it_should(text: str, formula: Formula) -> None:
    assert formula_text.read(text) == formula


bounds = st.tuples(st.integers(0, 10**12), st.none() | st.integers(0, 10**12)).filter(
    lambda pair: pair[1] is None or pair[0] <= pair[1]
)


def larger(inner: st.SearchStrategy[Formula]) -> st.SearchStrategy[Formula]:
    several = st.lists(inner, min_size=2, max_size=3).map(tuple)
    return (
        inner.map(Not)
        | several.map(And)
        | several.map(Or)
        | st.builds(
            lambda made, part, pair: made(part, *pair), st.sampled_from([Always, Eventually]), inner, bounds
        )
        | st.builds(lambda left, right, pair: Until(left, right, *pair), inner, inner, bounds)
    )


formulas = st.recursive(
    st.sampled_from(["P", "Q", "Always", "_x1"]).map(Atom) | st.booleans().map(Constant), larger, max_leaves=8
)


@settings(max_examples=300)
@given(formulas)
def test_what_is_written_is_read_as_the_same(formula: Formula) -> None:
    assert formula_text.read(formula_text.write(formula)) == formula


WORDS = [*"PQ()", "not", "and", "or", "implies", "always", "eventually", "until", "[0,1s]", "[2,inf]", "true"]


@settings(max_examples=300)
@given(st.lists(st.sampled_from(WORDS)))
def test_any_words_are_a_formula_or_refused_at_their_place(words: list[str]) -> None:
    text = " ".join(words)
    wrong = None
    try:
        found = formula_text.read(text, "formula")
    except InvalidInput as error:
        wrong = error
    if wrong:
        assert 1 <= int(wrong.where.removeprefix("formula, line 1, character ")) <= len(text) + 1
        assert wrong.remedy
    else:
        assert formula_text.read(formula_text.write(found)) == found


@pytest.mark.parametrize(
    ("text", "character", "message"),
    [
        ("", 1, "a variable is missing"),
        ("P and", 6, "a variable is missing"),
        ("P Q", 3, "'Q' is left over"),
        ("(P or Q", 8, ") is missing"),
        ("P until Q until R", 11, "until after until"),
        ("always[6 s, 1 s] P", 7, "bounds that end before they begin"),
        ("always[1 s] P", 11, ", is missing"),
        ("always[P, 1 s] P", 8, "a duration is missing"),
        ("always[0, 1 week] P", 11, "'1 week' is no duration"),
        ("always[0, 1 s P", 15, "] is missing"),
        ("P = Q", 3, "'=' means nothing here"),
        ("during", 1, "the word during means something already"),
        ("any", 1, "the word any means something already"),
        ("exists P", 9, "a variable is missing"),
        ("exists not P", 8, "a variable is missing"),
        ("not " * 99 + "P", 157, "more than 40 levels"),
    ],
)
def test_a_mistake_is_refused_where_it_is(text: str, character: int, message: str) -> None:
    with pytest.raises(InvalidInput) as wrong:
        formula_text.read(text, "formula")
    assert str(wrong.value).startswith(f"formula, line 1, character {character}: {message}")
    assert wrong.value.remedy


UNITS_S = {"us": Fraction(1, 10**6), "ms": Fraction(1, 1000), "s": 1, "": 1, "min": 60, "h": 3600, "d": 86400}


@given(
    st.integers(0, 10**6), st.integers(0, 999), st.sampled_from(sorted(UNITS_S)), st.sampled_from(["", " "])
)
def test_a_duration_is_its_number_times_its_unit(whole: int, thousandths: int, unit: str, space: str) -> None:
    exact_us = (whole + Fraction(thousandths, 1000)) * UNITS_S[unit] * 10**6
    text = f"{whole}.{thousandths:03}{space}{unit}"
    if exact_us.denominator != 1 or not 0 < exact_us <= LONGEST_US:
        with pytest.raises(InvalidInput):
            read_duration(text, "within")
    else:
        assert read_duration(text, "within") == exact_us


@given(st.integers(1, LONGEST_US))
def test_a_duration_that_is_written_is_read_as_the_same(duration_us: int) -> None:
    assert read_duration(write_duration(duration_us), "within") == duration_us


@given(st.integers(1, 10**9))
def test_a_number_is_seconds(duration_us: int) -> None:
    assert read_duration(duration_us / 1e6, "within") == duration_us


@pytest.mark.parametrize(
    ("duration_us", "text"),
    [(0, "0 s"), (6 * S, "6 s"), (500_000, "500 ms"), (90 * S, "90 s"), (3600 * S, "1 h"), (7, "7 us")],
)
def test_a_duration_is_written_in_its_largest_unit(duration_us: int, text: str) -> None:
    assert write_duration(duration_us) == text


@pytest.mark.parametrize(
    "value", ["", "s", "-1 s", "6 x", "6 S", "1e3 s", "1 min 30 s", True, None, [6], -1, float("nan"), 1e300, 10**40]
)  # fmt: skip
def test_what_is_no_duration_is_refused(value: object) -> None:
    with pytest.raises(InvalidInput) as wrong:
        read_duration(value, "within")
    assert wrong.value.where == "within"
    assert wrong.value.remedy
