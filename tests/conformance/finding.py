"""What the engine and the enumerator find in a case, in one form."""

from __future__ import annotations

from conformance.case import Case, Found, pairs_of
from rules.enumerator import enumerate_matches

from semap.rules.compilation import compile_rule
from semap.rules.condition import compile_condition
from semap.rules.matching.automaton import FOREVER_US

Both = tuple[list[Found], list[Found]]
"""Matches and timeouts, ascending."""


def expected(case: Case) -> Both:
    """As the case says, each with its stamp: that of its last row, if it says no other."""
    stamped = [
        [
            Found(
                found.pairs,
                case.rows[found.pairs[-1][0] - 1].stamp_us if found.stamp_us is None else found.stamp_us,
            )
            for found in every
        ]
        for every in (case.matches, case.timeouts or ())
    ]
    return _ordered(*stamped)


def by_engine(case: Case) -> Both:
    """Row by row; then it is told that no row will come."""
    program = compile_rule(case.declaration)
    state = None
    found = []
    for row in case.rows:
        state, matches = program.step(state, row)
        found += matches
    state, matches = program.advance(state, FOREVER_US)
    found += matches
    assert state is None
    return _ordered(
        *([Found(pairs_of(each), each.stamp_us) for each in found if each.type == event_type]
        for event_type in ("found", "timed_out"))
    )  # fmt: skip


def by_enumerator(case: Case) -> Both:
    """Trying everything."""
    declaration = case.declaration
    conditions = {name: compile_condition(condition) for name, condition in declaration.define.items()}
    found = enumerate_matches(
        case.pattern,
        conditions,
        declaration.within,
        declaration.after_match,
        case.rows,
        times_out=case.timeouts is not None,
    )
    return _ordered(
        *([Found(tuple((place + 1, variable) for variable, place in each.rows), each.stamp_us)
           for each in found if each.kind == kind]
        for kind in ("match", "timeout"))
    )  # fmt: skip


def _ordered(matches: list[Found], timeouts: list[Found]) -> Both:
    return sorted(matches, key=_key), sorted(timeouts, key=_key)


def _key(found: Found) -> tuple[int, object]:
    assert found.stamp_us is not None
    return found.stamp_us, found.pairs
