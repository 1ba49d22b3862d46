"""Ways: the shortest against networkx over all corners; the walk along them."""

from itertools import combinations

import networkx
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from semap_ingest.simulation.motion import STEP_S, walk
from semap_ingest.simulation.way import (
    ACCELERATION_MPS2,
    SPACING_M,
    distances_along,
    evenly_spaced,
    headings,
    rounded,
    shortest_way,
)

BLOCK = st.tuples(st.integers(1, 8), st.integers(1, 8), st.floats(0.4, 1.5), st.floats(0.4, 1.5))


@settings(max_examples=25)
@given(st.lists(BLOCK, min_size=1, max_size=4))
def test_shortest_way_around_blocks(blocks: list) -> None:
    area = shapely.box(0, 0, 10, 10).difference(
        shapely.union_all([shapely.box(x - a, y - b, x + a, y + b) for x, y, a, b in blocks])
    )
    start, end = (0.05, 0.07), (9.93, 9.96)
    graph = networkx.Graph()
    graph.add_nodes_from([start, end])
    corners = {start, end, *map(tuple, shapely.get_coordinates(area))}
    for first, second in combinations(corners, 2):
        line = shapely.LineString([first, second])
        if area.covers(line):
            graph.add_edge(first, second, weight=line.length)
    found = shortest_way(area, np.array(start), np.array(end))
    if not networkx.has_path(graph, start, end):
        assert found is None
        return
    assert found is not None
    assert tuple(found[0]) == start
    assert tuple(found[-1]) == end
    assert area.covers(shapely.LineString(found))
    expected_m = networkx.shortest_path_length(graph, start, end, weight="weight")
    assert distances_along(found)[-1] == pytest.approx(expected_m)


def test_no_way_out_of_a_closed_room_or_from_outside() -> None:
    rooms = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)])
    assert shortest_way(rooms, np.array([0.5, 0.5]), np.array([2.5, 0.5])) is None
    assert shortest_way(rooms, np.array([5.0, 5.0]), np.array([2.5, 0.5])) is None


def test_rounded_bend_passes_its_corner_closely() -> None:
    way = rounded(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]))
    assert way[0].tolist() == [0, 0]
    assert way[-1].tolist() == [3, 3]
    assert np.linalg.norm(way - [3, 0], axis=1).min() < 0.09
    assert np.linalg.norm(np.diff(way, axis=0), axis=1) == pytest.approx(SPACING_M, rel=0.05)
    assert np.abs(np.diff(headings(way))).max() < np.radians(6)


@pytest.mark.parametrize("length_m", [0.0, 0.01, 0.3, 5.0])
def test_walk_goes_from_rest_to_rest(length_m: float) -> None:
    way = evenly_spaced(np.array([[1.0, 1.0], [1.0, 1.0 + length_m]]))
    motion = walk(way, 0.0, 1.2)
    assert np.isfinite(motion.position_m).all()
    if length_m == 0:
        return
    assert motion.position_m[-1] == pytest.approx([1.0, 1.0 + length_m])
    assert np.cos(motion.heading_rad[-1] - np.pi / 2) == pytest.approx(1)
    speeds = np.linalg.norm(np.diff(motion.position_m, axis=0), axis=1) / STEP_S
    assert speeds.max() <= min(1.2, np.sqrt(ACCELERATION_MPS2 * length_m)) + 0.02
    assert np.abs(np.diff(speeds)).max() / STEP_S < ACCELERATION_MPS2 * 1.1


def test_walk_slows_down_in_bends() -> None:
    way = rounded(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]))
    motion = walk(way, 0.0, 1.4)
    speeds = np.linalg.norm(np.diff(motion.position_m, axis=0), axis=1) / STEP_S
    corner = np.argmin(np.linalg.norm(motion.position_m - [3, 0], axis=1))
    assert speeds[corner] < 0.8
    assert speeds.max() > 1.2
