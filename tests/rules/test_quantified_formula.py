"""Formulas with `exists` and `forall`, against an evaluation moment by moment that tries every interval."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rules.interval_rows import relation, run, run_by_deadlines, said
from rules.test_formula_program import END, bounds
from rules.test_past_formula import FIRST, LAST, holds

from semap.errors import InvalidInput
from semap.rules.compilation import compile_rule
from semap.rules.formula import (
    Always,
    And,
    Atom,
    Eventually,
    Exists,
    Formula,
    Historically,
    Not,
    Once,
    Or,
    Since,
    Until,
)
from semap.rules.language import formula_text
from semap.rules.language.reading import parse_declaration
from semap.rules.row import Row
from semap.rules.temporal.formula_json import dump_formula, load_formula
from semap.rules.temporal.metric import back_us, horizon_us

DEFINE = {
    "S": "input = 'asks'",
    "P": "input = 'in_room'",
    "L": "input = 'holds' and track_id = S.track_id",
    "M": "input = 'in_room' and track_id <> S.track_id",
    "K": "input = 'holds' and instance_id = L.instance_id and track_id <> S.track_id",
    "N": "input = 'holds' and track_id = M.track_id",
    "Q": "input = 'holds' and track_id = M.track_id and instance_id = L.instance_id",
}
SCOPES: Mapping[str, frozenset[str]] = {
    "P": frozenset(), "K": frozenset("L"), "N": frozenset("M"), "Q": frozenset("LM"),
}  # fmt: skip


def meant(name: str, row: Row, bound: Mapping[str, Row]) -> bool:
    """What `DEFINE` says, in Python."""
    of, track, lock = row.values["input"], row.values["track_id"], row.values["instance_id"]
    mine = bound["S"].values["track_id"]
    match name:
        case "P":
            return of == "in_room"
        case "L":
            return of == "holds" and track == mine
        case "M":
            return of == "in_room" and track != mine
        case "K":
            return of == "holds" and lock == bound["L"].values["instance_id"] and track != mine
        case "N":
            return of == "holds" and track == bound["M"].values["track_id"]
    of_m = track == bound["M"].values["track_id"]
    return of == "holds" and of_m and lock == bound["L"].values["instance_id"]


@dataclass(frozen=True)
class Bounds:
    """The intervals that there are, as rows with the moments at which they last, and what is bound."""

    intervals: tuple[tuple[Row, frozenset[int]], ...]
    bound: Mapping[str, Row]

    def __getitem__(self, name: str) -> set[int]:
        return {at for row, moments in self.intervals if meant(name, row, self.bound) for at in moments}

    def ways(self, name: str) -> Iterator[tuple[set[int], Bounds]]:
        for row, moments in self.intervals:
            if meant(name, row, self.bound):
                yield set(moments), Bounds(self.intervals, {**self.bound, name: row})


@st.composite
def formulas(draw: st.DrawFn, unbounded: bool = False) -> Formula:
    """Each of L and M is quantified once, in any order, or not at all."""

    def inside(scope: frozenset[str], left: tuple[str, ...], depth: int) -> Formula:
        kinds = ["atom", "not", "and", "past", "past", "since", "ahead", *["exists"] * 4]
        kind = draw(st.sampled_from(kinds)) if depth else "exists" if left and not scope else "atom"
        window = draw(bounds(3, unbounded))
        if kind == "exists" and left:
            name = draw(st.sampled_from(left))
            rest = tuple(each for each in left if each != name)
            return Exists(name, inside(scope | {name}, rest, depth - 1 if depth else 0))
        match kind:
            case "not":
                return Not(inside(scope, left, depth - 1))
            case "and":
                joined = draw(st.sampled_from((And, Or)))
                return joined((inside(scope, left, depth - 1), inside(scope, (), depth - 1)))
            case "past":
                return draw(st.sampled_from((Once, Historically)))(inside(scope, left, depth - 1), *window)
            case "ahead":
                return draw(st.sampled_from((Eventually, Always)))(inside(scope, left, depth - 1), *window)
            case "since":
                of_two = draw(st.sampled_from((Since, Until)))
                return of_two(inside(scope, (), depth - 1), inside(scope, left, depth - 1), *window)
        return Atom(draw(st.sampled_from([name for name, asks in SCOPES.items() if asks <= scope])))

    first = Exists("L", inside(frozenset("L"), ("M",), draw(st.integers(0, 3))))
    other = Exists("M", inside(frozenset("M"), ("L",), draw(st.integers(0, 3))))
    quantified = draw(st.sampled_from((first, other)))
    windowed = draw(st.sampled_from((Eventually, Always, Once, Historically)))
    whole = windowed(draw(st.sampled_from((quantified, Not(quantified)))), *draw(bounds(6, unbounded)))
    return draw(st.sampled_from((quantified, Not(quantified), whole, whole, whole)))


FITTING = formulas().filter(lambda formula: back_us(formula) <= 20 and horizon_us(formula) <= 20)
toggling = st.dictionaries(
    st.tuples(st.sampled_from(("in_room", "holds")), st.integers(1, 3), st.integers(1, 2)),
    st.sets(st.integers(FIRST, FIRST + 15), min_size=1, max_size=4),
    min_size=2,
    max_size=6,
)
asking = st.sets(st.tuples(st.integers(FIRST, FIRST + 18), st.sampled_from((1, 2))), min_size=1, max_size=3)


def compiled(formula: Formula) -> Any:
    text = formula_text.write(formula)
    used = {name: said for name, said in DEFINE.items() if name == "S" or name in text.replace("Always", "")}
    return compile_rule(parse_declaration({
        "name": "made", "input": ["in_room", "holds", "asks"], "when": "S", "formula": text, "define": used,
        "emit": {"holds": "holds", "fails": "fails"},
    }))  # fmt: skip


def rows_of(
    toggles: Mapping[tuple[str, int, int], set[int]], asked: set[tuple[int, int]]
) -> tuple[list[Row], tuple[tuple[Row, frozenset[int]], ...]]:
    """The rows, and the intervals that they begin and end."""
    rows, intervals = [], []
    for (query, track, lock), moments in toggles.items():
        stamps = sorted(moments)
        for place, at in enumerate(stamps):
            row = relation(at, "ended" if place % 2 else "began", query, track, lock)
            rows.append(row)
            if place % 2 == 0:
                end = stamps[place + 1] if place + 1 < len(stamps) else LAST + 1
                intervals.append((row, frozenset(range(at, end))))
    rows += [relation(at, "began", "asks", track) for at, track in asked]
    return sorted(rows, key=lambda row: row.order), tuple(intervals)


@settings(max_examples=400, deadline=None)
@given(FITTING, toggling, asking)
def test_what_is_quantified_is_as_trying_every_interval_says(
    formula: Formula, toggles: dict[tuple[str, int, int], set[int]], asked: set[tuple[int, int]]
) -> None:
    rows, intervals = rows_of(toggles, asked)
    _, found = run(compiled(formula), rows, END)
    moments = {row.stamp_us for row in rows}
    starts = [row for row in rows if row.values["input"] == "asks"]
    assert {match.rows[0][1].uid: match.type == "holds" for match in found} == {
        row.uid: holds(formula, row.stamp_us, Bounds(intervals, {"S": row}), moments) for row in starts
    }
    for match in found:
        begun = match.rows[0][1].stamp_us
        assert begun <= match.stamp_us <= begun + horizon_us(formula)


@settings(max_examples=200, deadline=None)
@given(formulas(unbounded=True), toggling, asking, st.sets(st.integers(0, 90)))
def test_no_cut_and_no_watermark_changes_what_is_found(
    formula: Formula,
    toggles: dict[tuple[str, int, int], set[int]],
    asked: set[tuple[int, int]],
    advances: set[int],
) -> None:
    program, (rows, _) = compiled(formula), rows_of(toggles, asked)
    _, whole = run(program, rows, END)
    _, in_pieces = run(program, rows, END, advances, stored=True)
    assert said(in_pieces) == said(whole)
    _, announced = run_by_deadlines(program, rows, END)
    assert said(match for _, match in announced) == said(whole)


@settings(max_examples=100, deadline=None)
@given(formulas(unbounded=True))
def test_they_are_written_and_stored_as_they_are(formula: Formula) -> None:
    assert load_formula(dump_formula(formula)) == formula
    assert formula_text.read(formula_text.write(formula)) == formula


def test_what_has_gone_is_forgotten() -> None:
    program, state = compiled(Once(Exists("M", Atom("N")), 0, 10)), None
    for moment in range(0, 4000, 20):
        state, _ = program.step(state, relation(moment, "began", "in_room", moment % 3))
        state, _ = program.step(state, relation(moment + 5, "ended", "in_room", moment % 3))
        state, _ = program.advance(state, moment + 19)
        assert state is None


CLAUSES = {"name": "made", "input": ["in_room", "holds"], "emit": {"holds": "found"}}
LOCK = {"L": "input = 'holds'", "P": "track_id = L.track_id"}


@pytest.mark.parametrize(
    ("formula", "define", "clauses", "message"),
    [
        ("exists L P or P", LOCK, {}, "there is neither a property nor a variable L"),
        ("exists L P and exists L P", LOCK, {}, "the variable L of a quantifier stands for something else"),
        ("exists L (P and L)", LOCK, {}, "the variable L of a quantifier stands for something else"),
        ("exists L P", LOCK, {"when": "L"}, "L is quantified in the formula"),
        ("exists A exists B exists C exists D true", dict.fromkeys("ABCD", "type = 'began'"), {}, "more than 3"),
        ("exists P", {"P": "type = 'began'"}, {}, "a variable is missing"),
        ("exists L P", {"L": "track_id = P.track_id", "P": "type = 'began'"}, {}, "neither a property nor a variable"),
    ],
)  # fmt: skip
def test_a_variable_stands_for_one_thing(
    formula: str, define: dict[str, str], clauses: dict[str, str], message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        parse_declaration({**CLAUSES, "formula": formula, "define": define, **clauses})


def verdicts(formula: str, define: dict[str, str], rows: list[tuple[int, str, str, int, int]]) -> list[bool]:
    """Of each row at which it is asked, by its stamp."""
    program = compile_rule(parse_declaration({
        "name": "made", "input": sorted({row[2] for row in rows}), "when": "S", "formula": formula, "define": define,
        "emit": {"holds": "holds", "fails": "fails"},
    }))  # fmt: skip
    _, found = run(program, [relation(at, kind, *rest) for at, kind, *rest in rows], 1_000)
    return [match.type == "holds" for match in sorted(found, key=lambda match: match.rows[0][1].stamp_us)]


ALICE, BOB, MALLORY, MERLIN = 1, 2, 3, 4


def test_published_after_a_manager_of_the_author_had_approved() -> None:
    """WhyMon's publish-approve-manager: the manager is bound in the approval and in the management."""
    define = {
        "S": "input = 'publishes'",
        "A": "input = 'approves' and instance_id = S.instance_id",
        "M": "input = 'manages' and track_id = A.track_id and instance_id = S.track_id",
    }
    rows = [
        (10, "began", "manages", MALLORY, ALICE),
        (11, "began", "manages", MERLIN, BOB),
        (20, "began", "approves", MERLIN, 160),
        (21, "ended", "approves", MERLIN, 160),
        (22, "began", "publishes", ALICE, 160),  # approved by somebody else's manager
        (23, "began", "publishes", BOB, 160),
        (24, "ended", "manages", MERLIN, BOB),
        (25, "began", "approves", MERLIN, 161),
        (26, "began", "publishes", BOB, 161),  # he no longer was when he approved
        (27, "began", "publishes", BOB, 160),  # he was then
        (90, "began", "publishes", BOB, 160),  # too long ago
    ]
    asked = verdicts("once[0 s, 0.00002 s] exists A M", define, rows)
    assert asked == [False, True, False, True, False]


def test_a_data_race_is_an_access_that_no_one_lock_has_protected() -> None:
    """WhyMon's data-race: some lock was held by whoever accessed it, whenever somebody did."""
    define = {
        "S": "input = 'accesses' and type = 'began'",
        "Q": "input = 'accesses' and instance_id = S.instance_id and track_id <> S.track_id",
        "L": "input = 'holds' and track_id = S.track_id",
        "P": "input = 'accesses' and instance_id = S.instance_id",
        "K": "input = 'holds' and instance_id = L.instance_id and track_id = P.track_id",
    }
    rows = [
        (10, "began", "holds", ALICE, 7),
        (11, "began", "accesses", ALICE, 100),  # nobody else yet
        (12, "ended", "accesses", ALICE, 100),
        (13, "ended", "holds", ALICE, 7),
        (14, "began", "holds", BOB, 7),
        (15, "began", "holds", BOB, 8),
        (16, "began", "accesses", BOB, 100),  # 7 was held each time
        (17, "ended", "accesses", BOB, 100),
        (18, "ended", "holds", BOB, 7),
        (19, "began", "accesses", BOB, 101),  # nobody else
        (20, "ended", "accesses", BOB, 101),
        (21, "began", "accesses", BOB, 100),  # 8 was not held by Alice
        (22, "ended", "accesses", BOB, 100),
        (23, "began", "accesses", ALICE, 101),  # no lock at all
    ]
    asked = verdicts("(once exists Q true) implies exists L historically forall P K", define, rows)
    assert asked == [True, True, True, False, False]
