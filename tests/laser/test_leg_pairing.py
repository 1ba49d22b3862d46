from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from semap_ingest.laser.pairing import CLEARLY, pair_legs
from semap_ingest.sensing.clusters import LegClusters

STRIDE_M = 0.75


def legs(places_m: object, score: object = 0.9, width_m: object = 0.12) -> LegClusters:
    places = np.asarray(places_m, np.float64).reshape(-1, 2)
    n = len(places)
    return LegClusters(
        0,
        "laser",
        places,
        np.tile(np.eye(2) * 1e-4, (n, 1, 1)),
        np.broadcast_to(np.asarray(score, np.float64), n).copy(),
        np.broadcast_to(np.asarray(width_m, np.float64), n).copy(),
        np.full(n, 8),
    )


def paired(clusters: LegClusters, is_free: object = True, **options: float) -> list[tuple[int, int]]:
    free = np.broadcast_to(np.asarray(is_free), len(clusters))
    return [(int(a), int(b)) for a, b in pair_legs(clusters, free, **options)]


def best_worth(places: np.ndarray, open_legs: tuple[int, ...]) -> float:
    """Of all ways to pair legs, by trying all."""
    if len(open_legs) < 2:
        return 0.0
    first, *rest = open_legs
    worth = best_worth(places, tuple(rest))
    for other in rest:
        apart = float(np.hypot(*(places[first] - places[other])))
        if apart <= STRIDE_M:
            others = tuple(leg for leg in rest if leg != other)
            worth = max(worth, STRIDE_M - apart + best_worth(places, others))
    return worth


def test_two_persons_far_apart() -> None:
    assert paired(legs([[0, 0], [5, 0], [0.3, 0], [5, 0.4]])) == [(0, 2), (1, 3)]


def test_a_leg_alone_and_both_in_one() -> None:
    assert paired(legs([[0, 0], [3, 0], [3.3, 0]], width_m=[0.12, 0.35, 0.12])) == [(0, -1), (1, -1), (2, -1)]


def test_legs_further_apart_than_a_stride_are_two_persons() -> None:
    assert paired(legs([[0, 0], [0.8, 0]])) == [(0, -1), (1, -1)]


def test_what_is_taken_or_unlikely_is_left_out() -> None:
    clusters = legs([[0, 0], [0.3, 0], [0.5, 0], [9, 9]], score=[0.9, 0.2, 0.9, 0.9])
    assert paired(clusters, [True, True, True, False]) == [(0, 2)]
    assert paired(clusters, [False] * 4) == []
    assert paired(clusters, min_score=0.1) == [(0, -1), (1, 2), (3, -1)]


def test_a_row_of_four_is_two_persons() -> None:
    """The middle two are closest, but then the outer ones would be left alone."""
    assert paired(legs([[0, 0], [0.35, 0], [0.65, 0], [1.0, 0]])) == [(0, 1), (2, 3)]


@pytest.mark.parametrize("places", [[], [[np.nan, 0.0]], [[0.0, 0.0], [np.nan, np.nan], [np.inf, 0.0]]])
def test_nothing_to_pair(places: list[list[float]]) -> None:
    assert all(second == -1 for _, second in paired(legs(places)))


def test_legs_at_one_place() -> None:
    assert paired(legs([[1, 1]] * 4)) in ([(0, 1), (2, 3)], [(0, 2), (1, 3)], [(0, 3), (1, 2)])


@given(st.lists(st.tuples(st.integers(0, 25), st.integers(0, 25)), max_size=7, unique=True))
@settings(max_examples=60, deadline=None)
def test_each_leg_once_and_the_pairs_worth_most(grid: list[tuple[int, int]]) -> None:
    places = np.array(grid, np.float64).reshape(-1, 2) / 10
    persons = paired(legs(places))
    used = [leg for person in persons for leg in person if leg != -1]
    assert sorted(used) == list(range(len(places)))
    pairs = [(a, b) for a, b in persons if b != -1]
    apart = {
        pair: float(np.hypot(*(places[pair[0]] - places[pair[1]])))
        for pair in combinations(range(len(places)), 2)
    }
    assert all(apart[pair] <= STRIDE_M for pair in pairs)
    clear = {
        (a, b)
        for (a, b), distance in apart.items()
        if distance <= STRIDE_M
        and all(
            CLEARLY * distance < other
            for pair, other in apart.items()
            if pair != (a, b) and other <= STRIDE_M and {a, b} & set(pair)
        )
    }
    assert clear <= set(pairs)
    rest = tuple(leg for leg in range(len(places)) if not any(leg in pair for pair in clear))
    worth = sum(STRIDE_M - apart[pair] for pair in pairs if pair not in clear)
    assert worth == pytest.approx(best_worth(places, rest), abs=1e-6)


def test_the_order_of_clusters_does_not_matter() -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(0, 4, (40, 2))
    order = rng.permutation(40)
    plain = {frozenset(pair) for pair in paired(legs(places))}
    mixed = {
        frozenset(int(order[leg]) if leg != -1 else -1 for leg in pair)
        for pair in paired(legs(places[order]))
    }
    assert plain == mixed
