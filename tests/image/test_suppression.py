"""Suppression against the textbook's loop."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.image.candidates import Candidates
from semap_ingest.image.suppression import MOST_CANDIDATES, suppress

Row = tuple[int, int, int, int, int, int]
ROWS = st.lists(
    st.tuples(
        st.integers(-60, 40),
        st.integers(-60, 40),
        st.integers(1, 30),
        st.integers(1, 30),
        st.integers(0, 2),
        st.integers(1, 1000),
    ),
    max_size=40,
    unique_by=lambda row: row[5],
)


def candidates_of(rows: list[Row]) -> Candidates:
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    corners = np.hstack([table[:, :2], table[:, :2] + table[:, 2:4]])
    return Candidates(corners, table[:, 5] / 1000, table[:, 4].astype(np.int64))


def overlap(one: Row, other: Row) -> tuple[int, int]:
    """Area in common and area of both together, in whole numbers."""
    across = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    along = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    common = max(across, 0) * max(along, 0)
    return common, one[2] * one[3] + other[2] * other[3] - common


def kept_by_the_loop(rows: list[Row]) -> list[float]:
    kept: list[Row] = []
    for row in sorted(rows, key=lambda each: -each[5]):
        pairs = [overlap(row, other) for other in kept if other[4] == row[4]]
        if all(20 * common <= 9 * union for common, union in pairs):
            kept.append(row)
    return [row[5] / 1000 for row in kept]


@given(ROWS)
def test_the_loop_agrees(rows: list[Row]) -> None:
    # 0.45 as a binary fraction is just below 9/20: a pair that overlaps by exactly that may be judged either way.
    exact = [
        1
        for i, one in enumerate(rows)
        for other in rows[:i]
        if 20 * overlap(one, other)[0] == 9 * overlap(one, other)[1]
    ]
    if not exact:
        assert suppress(candidates_of(rows), 0.45).score.tolist() == kept_by_the_loop(rows)


@given(ROWS)
def test_the_order_of_candidates_does_not_matter(rows: list[Row]) -> None:
    forwards, backwards = suppress(candidates_of(rows), 0.5), suppress(candidates_of(rows[::-1]), 0.5)
    assert forwards.score.tolist() == backwards.score.tolist()
    assert forwards.corners_px.tolist() == backwards.corners_px.tolist()


def test_of_equals_the_first_stays() -> None:
    twice = candidates_of([(0, 0, 10, 10, 0, 500), (1, 0, 10, 10, 0, 500)])
    assert suppress(twice, 0.5).corners_px.tolist() == [[0, 0, 10, 10]]


def test_only_the_best_of_very_many_are_looked_at() -> None:
    many = candidates_of([(20 * i, 0, 10, 10, 0, i + 1) for i in range(2 * MOST_CANDIDATES)])
    assert suppress(many, 0.5).score.tolist() == many.score[::-1][:MOST_CANDIDATES].tolist()
