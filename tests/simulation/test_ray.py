"""Rays: against a search in small steps in plain Python, and against shapely."""

from math import cos, hypot, sin

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.simulation.ray import is_crossed, is_near, to_circles, to_segments

NUMBER = st.floats(-5, 5).map(lambda value: round(value, 2))
POINT = st.tuples(NUMBER, NUMBER)
FROM = (0.013, -0.027)
"""Off the grid of the points, so that no ray runs along a segment."""


def unit(angle: float) -> np.ndarray:
    return np.array([[cos(angle), sin(angle)]])


@given(st.floats(0, 6.28), st.lists(st.tuples(POINT, POINT), max_size=5))
def test_distance_to_segments(angle: float, segments: list) -> None:
    ray = shapely.LineString([FROM, np.add(FROM, 20 * unit(angle)[0])])
    met = [
        hypot(*np.subtract(point.coords[0], FROM))
        for begin, end in segments
        if begin != end
        for point in shapely.get_parts(ray.intersection(shapely.LineString([begin, end])))
        if not point.is_empty and point.geom_type == "Point"
    ]
    found = to_segments(np.array(FROM), unit(angle), np.array(segments, dtype=float).reshape(-1, 2, 2))[0]
    # Where a ray just touches an end, one of both may miss it.
    touched = any(
        shapely.LineString([begin, end]).distance(ray) < 1e-9 and ray.distance(shapely.Point(tip)) < 1e-9
        for begin, end in segments
        for tip in (begin, end)
    )
    assert touched or found == pytest.approx(min(met, default=np.inf), abs=1e-6)


@given(st.floats(0, 6.28), st.lists(POINT, max_size=4), st.floats(0.05, 0.5))
def test_distance_to_circles(angle: float, middles: list, radius_m: float) -> None:
    expected = np.inf
    for x, y in middles:
        dx, dy = x - FROM[0], y - FROM[1]
        ahead, beside = dx * cos(angle) + dy * sin(angle), dy * cos(angle) - dx * sin(angle)
        if abs(beside) < radius_m and ahead - (radius_m**2 - beside**2) ** 0.5 > 0:
            expected = min(expected, ahead - (radius_m**2 - beside**2) ** 0.5)
    found = to_circles(np.array(FROM), unit(angle), np.array(middles, dtype=float).reshape(-1, 2), radius_m)[
        0
    ]
    assert found == pytest.approx(expected, abs=1e-6)


@given(POINT, st.lists(st.tuples(POINT, POINT), max_size=5))
def test_line_of_sight(to: tuple, segments: list) -> None:
    sight = shapely.LineString([FROM, to])
    walls = [shapely.LineString(segment) for segment in segments if segment[0] != segment[1]]
    found = is_crossed(np.array(FROM), np.array([to]), np.array(segments, dtype=float).reshape(-1, 2, 2))[0]
    doubtful = any(
        shapely.Point(tip).distance(line) < 1e-9
        for wall in walls
        for tip, line in [(wall.coords[0], sight), (wall.coords[1], sight), (to, wall)]
    )
    assert doubtful or found == any(sight.intersects(wall) for wall in walls)


@given(POINT, POINT, st.floats(0.05, 1.0))
def test_nearness_to_a_line_of_sight(to: tuple, middle: tuple, radius_m: float) -> None:
    distance_m = shapely.LineString([FROM, to]).distance(shapely.Point(middle))
    found = is_near(np.array(FROM), np.array([to]), np.array([middle]), radius_m)[0]
    assert abs(distance_m - radius_m) < 1e-9 or found == (distance_m < radius_m)
