"""What is under way in parts that are shared: the same is found as by trying everything, at a cost without window."""

from __future__ import annotations

import json
import random
from collections import Counter
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from rules.enumerator import Found
from rules.pattern_cases import (
    Case,
    alone,
    patterns,
    program_of,
    simple_condition,
    streams,
)
from rules.test_matching import agree, compiled, expected, found, run

from semap.rules import pattern as p
from semap.rules.compilation import compile_rule
from semap.rules.declaration import AfterMatch, Windows
from semap.rules.language.reading import parse_declaration
from semap.rules.matching import all_matches, pattern_program, runner, shape
from semap.rules.matching.all_matches import AllMatchesProgram
from semap.rules.matching.automaton import FOREVER_US
from semap.rules.program import LossyProgram
from semap.rules.row import Row

S = 1_000_000
CONDITIONS = {"A": alone("a"), "B": alone("b")}
ALL = p.Sequence(
    (
        p.Element("next", p.Repeat(p.Variable("A"), 1, None, joint="any")),
        p.Element("any", p.Variable("B")),
    )
)
NESTED = p.Sequence(
    (
        p.Element("next", p.Repeat(p.Repeat(p.Variable("A"), 1, None), 1, None)),
        p.Element("next", p.Variable("B")),
    )
)

conditions = st.fixed_dictionaries(dict.fromkeys("ABCNMU", simple_condition))
windows = st.builds(Windows, st.one_of(st.none(), st.integers(3, 9)))
skips = st.one_of(
    st.sampled_from(("to next", "past last")).map(AfterMatch),
    st.builds(
        AfterMatch,
        st.sampled_from(("to first", "to last")),
        st.frozensets(st.sampled_from("ABC"), min_size=1),
    ),
)
shared_cases = st.builds(Case, patterns, conditions, windows, skips, streams(), st.just(False))
all_cases = st.builds(
    Case,
    patterns,
    conditions,
    windows,
    st.builds(AfterMatch, st.just("none"), at_most=st.integers(1, 4)),
    streams(),
    st.just(False),
)


@pytest.fixture
def _from_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Attempts are cohorts however few they are."""
    monkeypatch.setattr(pattern_program, "FEW", 0)
    monkeypatch.setattr(shape, "RUNS_AT_MOST", 0)


def run_cut(program: LossyProgram, case: Case, data: st.DataObject) -> list[Found]:
    """What is found with watermarks between rows, and with the state stored and loaded."""
    state: Any = None
    given_now: list[Found] = []
    for place, row in enumerate(case.rows):
        if place and data.draw(st.booleans(), label="watermark"):
            known_us = case.rows[place - 1].stamp_us
            state, new = program.advance(state, data.draw(st.integers(known_us, row.stamp_us)) - 1)
            given_now += found(new)
        state, new = program.step(state, row)
        given_now += found(new)
        if state is not None and data.draw(st.booleans(), label="cut"):
            stored = json.loads(json.dumps(program.dump(state)))
            state = program.load(stored)
            assert json.loads(json.dumps(program.dump(state))) == stored
    state, new = program.advance(state, FOREVER_US)
    assert state is None
    return [*given_now, *found(new)]


@pytest.mark.usefixtures("_from_the_first")
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(shared_cases, st.data())
def test_cohorts_end_as_each_attempt_by_itself_would(case: Case, data: st.DataObject) -> None:
    program = compiled(case)
    wanted = expected(case)
    agree(run(program, case.rows), wanted)
    assert sorted(run_cut(program, case, data), key=repr) == sorted(wanted, key=repr)


@settings(max_examples=300, deadline=None)
@given(all_cases, st.data())
def test_so_many_matches_are_told_and_the_others_counted(case: Case, data: st.DataObject) -> None:
    program = compiled(case)
    assume(isinstance(program, AllMatchesProgram))
    told = [each for at_once in run(program, case.rows) for each in at_once]
    wanted = Counter(expected(case))
    assert not Counter(told) - wanted
    ends = Counter(each.rows[-1][1] for each in wanted)
    assert Counter(each.rows[-1][1] for each in told) == Counter(
        {place: min(count, case.after.at_most) for place, count in ends.items()}
    )
    left = sum(count for _, count in program.untold)
    assert left == wanted.total() - len(told)
    program.untold.clear()
    assert run_cut(program, case, data) == told
    assert sum(count for _, count in program.untold) == left


def letters(count: int, of: str, seed: int = 1) -> list[Row]:
    chance = random.Random(seed)
    return [
        Row(place * S, 2, f"{place:06}", "relation", {"type": chance.choice(of)}) for place in range(count)
    ]


def counted(rows: list[Row], window: int) -> int:
    """How many matches `A+ any followed by any B` has: at each b, of a's in the window all sets but the empty."""
    return sum(
        2 ** sum(other.values["type"] == "a" for other in rows[max(place - window + 1, 0) : place]) - 1
        for place, row in enumerate(rows)
        if row.values["type"] == "b"
    )


@pytest.mark.parametrize("window", [1, 10, 100, 1_000])
def test_all_matches_of_a_wide_window_are_counted(window: int) -> None:
    rows = letters(3_000, "abx")
    program = program_of(ALL, CONDITIONS, Windows(window * S), AfterMatch("none", at_most=2))
    told = sum(map(len, run(program, rows)))
    assert told + sum(count for _, count in program.untold) == counted(rows, window)


def test_what_is_kept_of_all_matches_is_bounded_by_the_window() -> None:
    program = program_of(ALL, CONDITIONS, Windows(100 * S), AfterMatch("none", at_most=1))
    state: Any = None
    for row in letters(5_000, "ax"):
        state, _ = program.step(state, row)
    assert len(state.firsts) <= 100
    assert len(state.made) < 3 * (3 * 100) + all_matches.SPARE_PARTS


def test_without_a_window_the_oldest_attempts_at_all_matches_are_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(all_matches, "UNDER_WAY_AT_MOST", 8)
    program = program_of(ALL, CONDITIONS, Windows(), AfterMatch("none", at_most=1_000))
    state: Any = None
    for row in letters(9, "a"):
        state, _ = program.step(state, row)
    assert [row.uid for row in program.given_up] == ["000000", "000001", "000002"]
    _, matches = program.step(state, replace(letters(1, "b")[0], stamp_us=9 * S))
    assert len(matches) == 2**6 - 1


@pytest.mark.parametrize(
    ("condition", "most", "first"),
    [
        ("occupants > A.occupants", 25, "0000"),
        ("occupants > first(A.occupants)", 3, "0014"),
        ("occupants > last(A.occupants, 1)", 301, "0000"),
    ],
)
def test_runs_are_one_where_no_condition_can_tell_them_apart(condition: str, most: int, first: str) -> None:
    """Of 25 a's that may all be bound or not, no attempt has 2^25 runs."""
    document = {
        "input": "x",
        "pattern": "A+ any followed by any B",
        "define": {"A": "type = 'a'", "B": f"type = 'b' and {condition}"},
        "emit": "m",
    }
    program = compile_rule(parse_declaration(document, "r"))
    state: Any = None
    for place in range(25):
        said = {"type": "a", "occupants": 25 - place}
        state, _ = program.step(state, Row(place * S, 2, f"{place:04}", "relation", said))
        assert max(len(attempt.runs) for attempt in state.attempts) <= most
    last = {"type": "b", "occupants": 12}
    state, at_once = program.step(state, Row(25 * S, 2, "0025", "relation", last))
    _, later = program.advance(state, FOREVER_US)
    assert [match.rows[0][1].uid for match in (*at_once, *later)] == [first]


class Counting:
    """Counts what runs are asked at rows."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.moves = 0
        asked = runner.Runner._move

        def move(*args: Any) -> Any:
            self.moves += 1
            return asked(*args)

        monkeypatch.setattr(runner.Runner, "_move", move)


@pytest.mark.parametrize(
    ("node", "of", "skip"),
    [
        pytest.param(ALL, "a" * 25 + "x" * 25 + "b", "past last", id="rare end"),
        pytest.param(ALL, "ax", "past last", id="no end"),
        pytest.param(ALL, "ax", "to next", id="no end, each row"),
        pytest.param(NESTED, "a", "past last", id="nested"),
        pytest.param(NESTED, "a" * 99 + "x", "to next", id="nested, each row"),
    ],
)
def test_a_row_asks_as_many_runs_in_a_wide_window_as_in_a_narrow_one(
    monkeypatch: pytest.MonkeyPatch, node: p.Node, of: str, skip: Any
) -> None:
    counting = Counting(monkeypatch)
    rows = letters(4_000, of)
    moves = []
    for window in (20, 200, 2_000):
        program = program_of(node, CONDITIONS, Windows(window * S), AfterMatch(skip))
        state: Any = None
        counting.moves = 0
        for row in rows:
            state, _ = program.step(state, row)
        assert program.given_up == []
        moves.append(counting.moves)
    assert max(moves) < 2 * min(moves), moves
    assert max(moves) < 8 * len(rows)
