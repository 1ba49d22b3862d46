import networkx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from semap_ingest.laser.matching import worthiest_matching
from semap_ingest.laser.pairing import NEAREST, pair_legs
from semap_ingest.sensing.clusters import LegClusters

STRIDE_M = 0.75


def near(places_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    pairs = cKDTree(places_m).query_pairs(STRIDE_M, output_type="ndarray")
    return pairs, STRIDE_M - np.hypot(*(places_m[pairs[:, 0]] - places_m[pairs[:, 1]]).T)


def worth_of(pairs: np.ndarray, worth: np.ndarray) -> float:
    """What the best matching is worth, by the blossom algorithm."""
    graph = networkx.Graph()
    graph.add_weighted_edges_from((int(a), int(b), float(w)) for (a, b), w in zip(pairs, worth, strict=True))
    return float(sum(graph.edges[edge]["weight"] for edge in networkx.max_weight_matching(graph)))


@given(
    st.dictionaries(
        st.tuples(st.integers(0, 9), st.integers(0, 9)).filter(lambda pair: pair[0] < pair[1]),
        st.integers(-1, 9),
        max_size=20,
    )
)
@settings(max_examples=60, deadline=None)
def test_no_matching_is_worth_more(graph: dict[tuple[int, int], int]) -> None:
    pairs = np.array([*graph], np.int64).reshape(-1, 2)
    worth = np.array([*graph.values()], np.float64)
    rows = worthiest_matching(pairs, worth)
    assert len(np.unique(pairs[rows])) == 2 * len(rows)
    assert (np.diff(rows) > 0).all()
    assert (worth[rows] > 0).all()
    assert worth[rows].sum() == worth_of(pairs[worth > 0], worth[worth > 0])


@pytest.mark.parametrize(("count", "side_m", "part"), [(40, 4.0, 1.0), (40, 2.0, 0.998), (120, 3.0, 0.98)])
def test_a_crowd_is_paired_as_well_as_can_be(count: int, side_m: float, part: float) -> None:
    """Twenty persons in a room exactly; sixty on 9 m2 nearly, as many as stand shoulder to shoulder."""
    pairs, worth = near(np.random.default_rng(5).uniform(0, side_m, (count, 2)))
    rows = worthiest_matching(pairs, worth)
    assert len(np.unique(pairs[rows])) == 2 * len(rows)
    assert worth[rows].sum() >= part * worth_of(pairs, worth) - 1e-9


def test_thousands_of_legs_in_one_heap_are_each_of_one_person() -> None:
    count = 2000
    clusters = LegClusters(
        0,
        "laser",
        np.random.default_rng(2).uniform(0, 3, (count, 2)),
        np.tile(np.eye(2) * 1e-4, (count, 1, 1)),
        np.full(count, 0.9),
        np.full(count, 0.12),
        np.full(count, 8),
    )
    persons = pair_legs(clusters, np.ones(count, bool))
    legs = persons[persons >= 0]
    assert sorted(legs.tolist()) == list(range(count))
    pairs = persons[persons[:, 1] >= 0]
    apart = np.hypot(*(clusters.centre_m[pairs[:, 0]] - clusters.centre_m[pairs[:, 1]]).T)
    assert len(pairs) > 0.9 * count / 2
    assert (apart <= STRIDE_M).all()


def test_more_legs_at_one_place_than_are_looked_at() -> None:
    count = 3 * NEAREST
    clusters = LegClusters(
        0,
        "laser",
        np.ones((count, 2)),
        np.tile(np.eye(2), (count, 1, 1)),
        np.full(count, 0.9),
        np.full(count, 0.12),
        np.full(count, 8),
    )
    persons = pair_legs(clusters, np.ones(count, bool))
    assert sorted(persons[persons >= 0].tolist()) == list(range(count))
