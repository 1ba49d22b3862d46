"""Formulas whose atoms ask of the row at which they are asked: somebody else, nobody else."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rules.interval_rows import relation, run, said
from rules.test_formula_program import END
from rules.test_past_formula import FIRST, LAST, formulas, holds

from semap.errors import InvalidInput
from semap.rules.compilation import compile_rule
from semap.rules.formula import Formula
from semap.rules.language.formula_text import write
from semap.rules.language.reading import parse_declaration
from semap.rules.row import Row

DEFINE = {
    "S": "input = 'asks'",
    "P": "input = 'in_room' and track_id = S.track_id",
    "Q": "input = 'in_room' and track_id <> S.track_id",
}


def compiled(formula: str) -> Any:
    used = {name: text for name, text in DEFINE.items() if name == "S" or name in formula}
    return compile_rule(parse_declaration({
        "name": "made", "input": ["in_room", "asks"], "when": "S", "formula": formula, "define": used,
        "emit": {"holds": "holds", "fails": "fails"},
    }))  # fmt: skip


toggling = st.fixed_dictionaries(
    {track: st.sets(st.integers(FIRST, FIRST + 15), max_size=4) for track in (1, 2, 3)}
)
asking = st.sets(st.tuples(st.integers(FIRST, FIRST + 18), st.sampled_from((1, 2))), min_size=1, max_size=4)


def rows_of(toggles: dict[int, set[int]], asked: set[tuple[int, int]]) -> list[Row]:
    rows = [
        relation(moment, "ended" if place % 2 else "began", "in_room", track)
        for track, moments in toggles.items()
        for place, moment in enumerate(sorted(moments))
    ]
    return sorted(
        [*rows, *(relation(at, "began", "asks", track) for at, track in asked)], key=lambda row: row.order
    )


def moments_inside(toggles: dict[int, set[int]], tracks: set[int]) -> set[int]:
    return {
        at
        for at in range(LAST + 1)
        for track in tracks
        if sum(1 for each in toggles[track] if each <= at) % 2
    }


@settings(max_examples=250, deadline=None)
@given(formulas(False), toggling, asking)
def test_each_is_asked_of_its_own_and_of_others(
    formula: Formula, toggles: dict[int, set[int]], asked: set[tuple[int, int]]
) -> None:
    rows = rows_of(toggles, asked)
    _, found = run(compiled(write(formula)), rows, END)
    moments = {row.stamp_us for row in rows}
    wanted = {}
    for at, track in asked:
        true = {"P": moments_inside(toggles, {track}), "Q": moments_inside(toggles, {1, 2, 3} - {track})}
        wanted[at, track] = holds(formula, at, true, moments)
    assert {
        (match.rows[0][1].stamp_us, match.rows[0][1].values["track_id"]): match.type == "holds"
        for match in found
    } == wanted


@settings(max_examples=150, deadline=None)
@given(formulas(True), toggling, asking, st.sets(st.integers(0, 90)))
def test_no_cut_and_no_watermark_changes_what_is_found(
    formula: Formula, toggles: dict[int, set[int]], asked: set[tuple[int, int]], advances: set[int]
) -> None:
    program, rows = compiled(write(formula)), rows_of(toggles, asked)
    _, whole = run(program, rows, END)
    _, in_pieces = run(program, rows, END, advances, stored=True)
    assert said(in_pieces) == said(whole)


def test_nothing_is_kept_of_others_that_have_gone() -> None:
    program, state = compiled("not once[0 s, 0.00001 s] Q"), None
    for moment in range(0, 4000, 20):
        state, _ = program.step(state, relation(moment, "began", "in_room", moment % 3))
        state, _ = program.step(state, relation(moment + 5, "ended", "in_room", moment % 3))
        state, _ = program.advance(state, moment + 19)
        assert state is None


def test_only_the_row_at_which_a_formula_is_asked_may_be_asked_of() -> None:
    clauses = {"name": "made", "input": "in_room", "formula": "not Q", "emit": {"holds": "alone"}}
    for define, when in (
        ({"Q": "track_id <> P.track_id", "S": "type = 'began'"}, "S"),
        ({"Q": "track_id <> S.track_id"}, None),
        ({"Q": "type = 'began'", "S": "track_id <> S.track_id"}, "S"),
    ):
        with pytest.raises(InvalidInput, match="there is neither a property nor a variable"):
            parse_declaration({**clauses, "define": define, "when": when})
