"""Events of both layers paired: against scipy's assignment, which tries all pairs."""

from __future__ import annotations

from uuid import UUID

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from semap.batch.verdict import Finding, Judgement, compare

SAME_US, REACH_US = 10, 40
STAMPS = st.lists(st.integers(0, 300), max_size=8)


def findings(kind: str, stamps: list[int], first: int) -> list[Finding]:
    return [Finding(UUID(int=first + n), kind, stamp) for n, stamp in enumerate(stamps)]


def test_confirmed_amended_retracted_and_found() -> None:
    speed = [*findings("a", [100, 200, 300], 0), Finding(UUID(int=9), "b", 100, "ann")]
    batch = [*findings("a", [105, 230, 900], 20), Finding(UUID(int=29), "b", 100, "bob")]
    done = compare(speed, batch, SAME_US, REACH_US)
    assert set(done.judgements) == {
        Judgement(UUID(int=0), "confirmed"),
        Judgement(UUID(int=1), "amended", UUID(int=21)),
        Judgement(UUID(int=2), "retracted"),
        Judgement(UUID(int=9), "amended", UUID(int=29)),
    }
    assert done.found == (UUID(int=22),)


@given(STAMPS, STAMPS)
def test_most_pairs_at_the_least_distance(ours: list[int], theirs: list[int]) -> None:
    done = compare(findings("a", ours, 0), findings("a", theirs, 100), 0, REACH_US)
    retracted = sum(each.verdict == "retracted" for each in done.judgements)
    assert len(done.judgements) == len(ours)
    assert len(theirs) - len(done.found) == len(ours) - retracted
    apart = np.abs(np.subtract.outer(np.array(ours, float), np.array(theirs, float)))
    cost = np.where(apart <= REACH_US, apart - 1e6, 0.0)
    rows, columns = linear_sum_assignment(cost)
    pairs = [(r, c) for r, c in zip(rows, columns, strict=True) if apart[r, c] <= REACH_US]
    assert len(ours) - retracted == len(pairs)
    by = {each.event_id.int: each.by_event_id.int - 100 for each in done.judgements if each.by_event_id}
    confirmed = sum(each.verdict == "confirmed" for each in done.judgements)
    assert len(by) + confirmed == len(pairs)
    assert sum(apart[r, c] for r, c in by.items()) == sum(apart[r, c] for r, c in pairs)


@given(STAMPS)
def test_what_is_the_same_is_confirmed(stamps: list[int]) -> None:
    done = compare(findings("a", stamps, 0), findings("a", stamps, 100), SAME_US, REACH_US)
    assert {each.verdict for each in done.judgements} <= {"confirmed"}
    assert done.found == ()
