"""The automaton against the enumerator, which tries everything."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from rules import pattern_cases
from rules.enumerator import Found, enumerate_matches
from rules.pattern_cases import Case, alone, cases, condition_sets, remembered_cases, streams
from rules.words import TooMany

from semap.errors import InvalidInput
from semap.rules import pattern as p
from semap.rules.bound import Condition
from semap.rules.compilation import compile_rule
from semap.rules.declaration import AfterMatch, Windows
from semap.rules.language.reading import parse_declaration
from semap.rules.matching import pattern_program as matching
from semap.rules.matching.automaton import FOREVER_US
from semap.rules.matching.pattern_program import PatternState
from semap.rules.matching.sharing import compile_program
from semap.rules.matching.surrounded_program import SurroundedProgram
from semap.rules.matching.telling import Emits, Telling
from semap.rules.program import LossyProgram, Match
from semap.rules.row import Row

S = 1_000_000


def found(matches: Iterable[Match]) -> list[Found]:
    return [
        Found(match.type, match.stamp_us, tuple((variable, int(row.uid)) for variable, row in match.rows))
        for match in matches
    ]


def run(program: LossyProgram, rows: list[Row]) -> list[list[Found]]:
    """What each row gave, and the end of the stream."""
    state: PatternState | None = None
    given = []
    for row in rows:
        state, new = program.step(state, row)
        given.append(found(new))
    state, new = program.advance(state, FOREVER_US)
    assert state is None
    return [*given, found(new)]


def agree(given: list[list[Found]], wanted: list[Found]) -> None:
    """The same is found, and what is given at once is in the order wanted."""
    places = [[wanted.index(each) for each in at_once if each in wanted] for at_once in given]
    assert sorted((each for at_once in given for each in at_once), key=repr) == sorted(wanted, key=repr)
    assert places == [sorted(at_once) for at_once in places]


def compiled(case: Case) -> LossyProgram:
    try:
        return case.program()
    except InvalidInput:
        assume(False)
        raise


def expected(case: Case) -> list[Found]:
    try:
        return enumerate_matches(
            case.node, case.conditions, case.windows, case.after, case.rows, times_out=case.times_out
        )
    except TooMany:
        assume(False)
        raise


@settings(max_examples=400, deadline=None)
@given(cases)
def test_it_finds_what_the_enumerator_finds(case: Case) -> None:
    agree(run(compiled(case), case.rows), expected(case))


@settings(max_examples=300, deadline=None)
@given(remembered_cases, st.lists(streams(), min_size=1, max_size=4))
def test_what_a_step_did_is_remembered_only_where_it_is_the_same_again(
    case: Case, others: list[list[Row]]
) -> None:
    program = compiled(case)
    for rows in (case.rows, *others, case.rows):
        agree(run(program, rows), expected(replace(case, rows=rows)))


@settings(max_examples=250, deadline=None)
@given(cases, st.data())
def test_cuts_and_watermarks_change_nothing(case: Case, data: st.DataObject) -> None:
    program = compiled(case)
    whole = run(program, case.rows)
    state: PatternState | None = None
    given_now: list[Match] = []
    for place, row in enumerate(case.rows):
        if data.draw(st.booleans(), label="watermark"):
            known_us = case.rows[place - 1].stamp_us if place else row.stamp_us - 1
            watermark_us = data.draw(st.integers(known_us, row.stamp_us)) - 1
            state, new = program.advance(state, watermark_us)
            given_now += new
            assert state is None or (program.deadline_us(state) or watermark_us + 1) > watermark_us
        state, new = program.step(state, row)
        given_now += new
        if state is not None and data.draw(st.booleans(), label="cut"):
            stored = json.loads(json.dumps(program.dump(state)))
            program = case.program()
            state = program.load(stored)
            assert json.loads(json.dumps(program.dump(state))) == stored
    state, new = program.advance(state, FOREVER_US)
    assert state is None
    at_once = sorted((each for some in whole for each in some), key=repr)
    assert sorted(found([*given_now, *new]), key=repr) == at_once


@settings(max_examples=100, deadline=None)
@given(cases)
def test_nothing_waits_beyond_its_deadline(case: Case) -> None:
    """Advanced by its own deadlines alone, a key comes to rest with everything given."""
    program = compiled(case)
    state: PatternState | None = None
    given_now: list[Match] = []
    for row in case.rows:
        while (deadline_us := program.deadline_us(state)) is not None and deadline_us < row.stamp_us:
            before = state
            state, new = program.advance(state, deadline_us)
            assert state is not before
            given_now += new
        state, new = program.step(state, row)
        given_now += new
    while (deadline_us := program.deadline_us(state)) is not None:
        state, new = program.advance(state, deadline_us)
        given_now += new
    state, new = program.advance(state, FOREVER_US)
    everything = [each for at_once in run(case.program(), case.rows) for each in at_once]
    assert sorted(found([*given_now, *new]), key=repr) == sorted(everything, key=repr)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.sampled_from("ABC"), min_size=1, max_size=3), condition_sets(), streams(8))
def test_a_strict_sequence_is_given_with_the_row_that_completes_it(
    names: list[str], conditions: dict[str, Condition], rows: list[Row]
) -> None:
    node = p.Sequence(tuple(p.Element("next", p.Variable(name)) for name in names))
    case = Case(node, conditions, Windows(5), AfterMatch("to next"), rows)
    for place, at_once in enumerate(run(case.program(), rows)):
        matches = [each for each in at_once if each.kind == "match"]
        assert all(each.rows[-1][1] == place for each in matches)


def stream(text: str) -> list[Row]:
    """A row a second, the letters their types."""
    return [
        Row(place * S, 2, f"{place:04}", "relation", {"type": letter, "n": 0})
        for place, letter in enumerate(text)
    ]


def sequence(*parts: str | tuple[p.Joint, p.Node]) -> p.Node:
    elements = [
        p.Element("next", p.Variable(part)) if isinstance(part, str) else p.Element(*part) for part in parts
    ]
    return p.Sequence(tuple(elements))


CONDITIONS = {letter.upper(): alone(letter) for letter in "abc"}


def surrounded(pattern: str, define: dict[str, str], within: str, **clauses: object) -> SurroundedProgram:
    document = {
        "input": "x",
        "pattern": pattern,
        "define": define,
        "within": within,
        "emit": "match",
        **clauses,
    }
    program = compile_rule(parse_declaration(document, "r"))
    assert isinstance(program, SurroundedProgram)
    return program


def program_of(
    node: p.Node,
    windows: Windows | None = None,
    after: AfterMatch | None = None,
) -> LossyProgram:
    return pattern_cases.program_of(node, CONDITIONS, windows or Windows(), after or AfterMatch())


def rows_of(given: list[list[Found]]) -> list[list[str]]:
    return [
        [" ".join(f"{variable}{place}" for variable, place in each.rows) for each in some] for some in given
    ]


@pytest.mark.parametrize(
    ("node", "text", "wanted"),
    [
        pytest.param(sequence("A", "B"), "aab", [[], [], ["A1 B2"], []], id="at the row that completes it"),
        pytest.param(
            sequence("A", ("relaxed", p.Variable("B"))), "acab", [[], [], [], ["A0 B3"], []], id="relaxed"
        ),
        pytest.param(
            sequence("A", ("next", p.Repeat(p.Variable("B"), 1, None))),
            "abbc",
            [[], [], [], ["A0 B1 B2"], []],
            id="greedy: when the next row is another",
        ),
        pytest.param(
            sequence("A", ("next", p.Repeat(p.Variable("B"), 1, None, greedy=False))),
            "abbc",
            [[], ["A0 B1"], [], [], []],
            id="reluctant: at once",
        ),
        pytest.param(
            p.Permutation((p.Variable("A"), p.Variable("B"), p.Variable("C")), "relaxed"),
            "acbc",
            [[], [], ["A0 C1 B2"], [], []],
            id="any order: at the first that is there",
        ),
    ],
)
def test_a_match_is_given_once_it_is_decided(node: p.Node, text: str, wanted: list[list[str]]) -> None:
    assert rows_of(run(program_of(node), stream(text))) == wanted


def test_a_match_that_waits_for_more_is_given_when_its_window_ends() -> None:
    program = program_of(p.Repeat(p.Variable("A"), 1, None), Windows(3 * S))
    for _ in range(2):  # the second time, all of it is remembered
        state, matches = program.step(None, stream("a")[0])
        assert matches == ()
        assert program.deadline_us(state) == 3 * S - 1
        state, (match,) = program.step(state, stream("bbba")[3])
        assert (match.stamp_us, len(match.rows)) == (0, 1)
        assert state is not None
        assert [attempt.first.stamp_us for attempt in state.attempts] == [3 * S]


def test_what_time_can_only_end_is_forgotten_a_few_windows_later() -> None:
    program = program_of(sequence("A", "B"), Windows(3 * S))
    state, _ = program.step(None, stream("a")[0])
    assert program.deadline_us(state) == matching.PRUNED_AFTER * 3 * S - 1
    assert program.advance(state, 3 * S - 2) == (state, ())
    assert program.advance(state, 3 * S - 1) == (None, ())
    assert program.step(state, stream("cccb")[3]) == (None, ())


@pytest.mark.parametrize("skip", ["to next", "past last", "none"])
def test_rows_that_interest_none_of_many_attempts_change_nothing(skip: Any) -> None:
    program = program_of(sequence("A", ("relaxed", p.Variable("B"))), Windows(99 * S), AfterMatch(skip))
    state = None
    for row in stream("ac" * 20):
        before = state
        state, _ = program.step(state, row)
        assert (state is before) == (row.values["type"] == "c")
    assert state is not None
    given = feed(program, stream("ac" * 20 + "b"))
    assert [match.rows[0][1].stamp_us // S for match in given] == (
        [0] if skip == "past last" else [*range(0, 40, 2)]
    )


def test_an_automaton_with_too_many_ways_is_refused_at_once() -> None:
    optional = p.Repeat(p.Variable("A"), 0, 1)
    with pytest.raises(InvalidInput, match="too many ways") as refused:
        program_of(sequence("B", ("next", p.Repeat(p.Repeat(optional, 17, 17), 17, 17))))
    assert "A{0,9}" in refused.value.remedy


def test_an_absence_is_certain_when_its_window_ends() -> None:
    program = program_of(sequence("A", ("relaxed", p.Absent("B"))), Windows(5 * S))
    state, matches = program.step(None, stream("a")[0])
    assert matches == ()
    assert program.deadline_us(state) == 5 * S - 1
    assert program.advance(state, 5 * S - 2) == (state, ())
    state, matches = program.advance(state, 5 * S - 1)
    assert state is None
    assert [(match.type, match.stamp_us) for match in matches] == [("match", 5 * S)]


def test_a_later_match_does_not_wait_for_an_absence_that_cannot_skip_it() -> None:
    node = p.Alternation((sequence("A", ("relaxed", p.Absent("C"))), p.Variable("B")))
    given = run(program_of(node, Windows(5 * S)), stream("ab"))
    assert rows_of(given) == [[], ["B1"], ["A0"]]


def test_a_match_that_finish_drops_still_skips() -> None:
    program = compile_program(
        sequence("A", ("relaxed", p.Variable("B"))),
        CONDITIONS,
        Windows(),
        AfterMatch(),
        Telling(
            Emits("match"), lambda bound, stamp_us, *_: None if stamp_us < 3 * S else ({"n": stamp_us}, 0.5)
        ),
    )
    (match,) = feed(program, stream("aabab"))
    assert (match.rows[0][1].stamp_us, match.measures, match.confidence) == (3 * S, {"n": 4 * S}, 0.5)


def feed(program: LossyProgram, rows: list[Row]) -> list[Match]:
    state: PatternState | None = None
    matches: list[Match] = []
    for row in rows:
        state, new = program.step(state, row)
        matches += new
    return matches


def test_without_a_window_one_run_stands_for_all_that_began_later() -> None:
    program = program_of(sequence("A", ("relaxed", p.Variable("B"))))
    state: PatternState | None = None
    for row in stream("a" * 50):
        state, _ = program.step(state, row)
    assert state is not None
    assert len(state.attempts) == 1


def test_the_oldest_attempts_go_first_when_there_are_too_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matching, "RUNS_AT_MOST", 3)
    program = program_of(sequence("A", ("relaxed", p.Variable("B"))), after=AfterMatch("to next"))
    state: PatternState | None = None
    for row in stream("aaaaa"):
        state, _ = program.step(state, row)
    assert state is not None
    assert [row.uid for row in program.given_up] == ["0000", "0001"]
    assert [attempt.first.uid for attempt in state.attempts] == ["0002", "0003", "0004"]


def test_a_key_is_kept_for_the_row_before_only_within_the_window() -> None:
    program = surrounded("A B", {"A": "type <> prev(type)"}, "5 s")
    state, _ = program.step(None, stream("a")[0])
    state, _ = program.step(state, stream("aa")[1])
    assert (state.behind, state.inner) == ((stream("aa")[1],), None)
    assert program.deadline_us(state) == 6 * S - 1
    assert program.advance(state, 6 * S - 1) == (None, ())


@pytest.mark.parametrize(
    ("node", "windows", "says"),
    [
        (
            p.Sequence((p.Element("next", p.Absent("B")), p.Element("next", p.Variable("A")))),
            Windows(),
            "begins with",
        ),
        (sequence("A", ("relaxed", p.Absent("B"))), Windows(step_us=5), "may end in the absence of B"),
        (p.Repeat(p.Variable("A"), 301, 301), Windows(), "more than 300 positions"),
    ],
)
def test_what_cannot_be_matched_is_refused(node: p.Node, windows: Windows, says: str) -> None:
    with pytest.raises(InvalidInput, match=says) as refused:
        program_of(node, windows)
    assert refused.value.remedy


def test_rows_in_a_state_keep_everything_that_they_say() -> None:
    program = program_of(sequence("A", ("relaxed", p.Variable("B"))), Windows(9 * S))
    values = {"type": "a", "n": 1.5, "position": shapely.Point(1, 2), "attributes": {"x": [1, None]}}
    row = Row(1, 3, "u", "relation", values, ("Door", "Thing"))
    state, _ = program.step(None, row)
    assert state is not None
    loaded = program.load(json.loads(json.dumps(program.dump(state))))
    assert loaded == state
    assert loaded.attempts[0].first == row
