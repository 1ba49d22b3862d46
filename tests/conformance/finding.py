"""What the engine and the enumerator find in a case, in one form."""

from __future__ import annotations

import json

from conformance.case import Case, Found, pairs_of
from rules.enumerator import enumerate_matches

from semap.rules.compilation import compile_rule, neighbours_of
from semap.rules.condition import compile_condition
from semap.rules.matching.automaton import FOREVER_US
from semap.rules.pattern import Excluded
from semap.rules.program import Match

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
    found = matches_of(case)
    return _ordered(
        *([Found(pairs_of(each), each.stamp_us) for each in found if each.type == event_type]
        for event_type in ("found", "timed_out"))
    )  # fmt: skip


def matches_of(case: Case) -> list[Match]:
    """All that the engine tells, in its order; the state is stored and loaded after each row."""
    program = compile_rule(case.declaration)
    state = None
    found: list[Match] = []
    for row in case.rows:
        state, matches = program.step(state, row)
        found += matches
        if state is not None:
            state = program.load(json.loads(json.dumps(program.dump(state))))
    state, matches = program.advance(state, FOREVER_US)
    assert state is None
    return found + list(matches)


def by_enumerator(case: Case) -> Both:
    """Trying everything; where rows are told one by one, each of them is found."""
    declaration = case.declaration
    rows = [*neighbours_of(declaration, case.pattern).all_told(case.rows)]
    conditions = {name: compile_condition(condition) for name, condition in declaration.define.items()}
    found = enumerate_matches(
        case.pattern,
        conditions,
        declaration.within,
        declaration.after_match,
        rows,
        times_out=case.timeouts is not None,
    )
    matches, timeouts = [], []
    for each in found:
        bound = [(place + 1, variable) for variable, place in each.rows]
        # an event has a row to stand at, if none is to be told the last
        pairs = tuple(pair for pair in bound if not isinstance(pair[1], Excluded)) or tuple(bound[-1:])
        if each.kind == "timeout":
            timeouts.append(Found(pairs, each.stamp_us))
        elif declaration.each_row and each.kind == "match":
            matches += [Found((pair,), case.rows[pair[0] - 1].stamp_us) for pair in pairs]
        else:
            matches.append(Found(pairs, each.stamp_us))
    return _ordered(matches, timeouts)


def unmatched_by_enumerator(case: Case) -> tuple[int, ...]:
    """The rows that none of the matches has, which the case names."""
    having = {number for found in case.matches for number, _ in found.pairs}
    return tuple(number for number in range(1, len(case.rows) + 1) if number not in having)


def _ordered(matches: list[Found], timeouts: list[Found]) -> Both:
    return sorted(matches, key=_key), sorted(timeouts, key=_key)


def _key(found: Found) -> tuple[int, object]:
    assert found.stamp_us is not None
    return found.stamp_us, found.pairs
