"""The assignment against trying all."""

from itertools import combinations, permutations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from semap_ingest.tracking.assignment import assign, unassigned

COSTS = st.one_of(st.floats(-20, 40), st.sampled_from([np.inf, -np.inf, np.nan]))


def least(cost: np.ndarray, alone: np.ndarray) -> float:
    """Of all partial assignments without forbidden pairs, the least sum of cost - alone."""
    rows, columns = cost.shape
    best = 0.0
    for size in range(1, min(rows, columns) + 1):
        for some in combinations(range(rows), size):
            for others in permutations(range(columns), size):
                chosen = cost[list(some), list(others)]
                if np.isfinite(chosen).all():
                    best = min(best, float((chosen - alone[list(some), 0]).sum()))
    return best


@given(data=st.data(), rows=st.integers(0, 4), columns=st.integers(0, 4))
@settings(max_examples=100, deadline=None)
def test_the_cheapest_partial_assignment_without_forbidden_pairs(
    data: st.DataObject, rows: int, columns: int
) -> None:
    cost = data.draw(arrays.arrays(np.float64, (rows, columns), elements=COSTS))
    alone = data.draw(arrays.arrays(np.float64, (rows, 1), elements=st.floats(-5, 20)))
    tracks, found = assign(cost, alone)
    assert len(set(tracks.tolist())) == len(tracks) == len(found) == len(set(found.tolist()))
    assert np.isfinite(cost[tracks, found]).all()
    assert (cost[tracks, found] < alone[tracks, 0]).all()
    assert abs((cost[tracks, found] - alone[tracks, 0]).sum() - least(cost, alone)) < 1e-9


def test_a_forbidden_pair_does_not_push_a_good_one_aside() -> None:
    cost = np.array([[1.0, 9.0], [2.0, np.inf]])
    tracks, found = assign(cost, 5.0)
    assert (tracks.tolist(), found.tolist()) == ([0], [0])


def test_what_is_left() -> None:
    assert unassigned(5, np.array([3, 0])).tolist() == [1, 2, 4]
    assert unassigned(0, np.zeros(0, np.int64)).tolist() == []
