"""A sweep of a laser that moved is what it would have been, had it stood."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from semap_ingest.laser.sweep import straightened
from semap_ingest.sensing.scan import Scan

STEP_RAD = math.radians(0.5)
BEAMS = 541


def distance_to_walls(x: float, y: float, angle: float) -> float:
    """Along a beam from a point inside, to the walls of a room of 8 by 6 m around the origin."""
    across, along = math.cos(angle) or 1e-12, math.sin(angle) or 1e-12
    reaches = [(math.copysign(4, across) - x) / across, (math.copysign(3, along) - y) / along]
    return min(reaches)


@given(st.floats(-0.4, 0.4), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.booleans())
def test_walls_are_where_they_are(turn_rad: float, x_m: float, y_m: float, backwards: bool) -> None:
    """Each point of the sweep of a laser that turns and moves evenly lies on a wall, from the first beam's pose."""
    step = -STEP_RAD if backwards else STEP_RAD
    first = -math.copysign(math.radians(135), step)
    ranges = [
        distance_to_walls(x_m * share, y_m * share, first + step * i + turn_rad * share)
        for i, share in enumerate(np.linspace(0, 1, BEAMS))
    ]
    first_T_last = np.eye(4)
    first_T_last[:3, :3] = Rotation.from_euler("z", turn_rad).as_matrix()
    first_T_last[:2, 3] = x_m, y_m
    scan = Scan(0, "laser", first, step, 0.05, 20.0, np.array(ranges, np.float32), 0.0001)
    points = straightened(scan, first_T_last).points_m
    off_m = np.minimum(np.abs(np.abs(points[:, 0]) - 4), np.abs(np.abs(points[:, 1]) - 3))
    assert off_m.max() < 1e-4
    assert (np.abs(points) < [4 + 1e-4, 3 + 1e-4]).all()


@given(st.lists(st.sampled_from([0.0, math.nan, math.inf, 1.0, 5.0, 19.9]), min_size=1, max_size=30))
def test_what_came_back_stays_what_came_back(ranges: list[float]) -> None:
    first_T_last = np.eye(4)
    first_T_last[:2, 3] = -0.5, 0.2
    scan = Scan(0, "laser", -1.0, 0.02, 0.3, 20.0, np.array(ranges, np.float32), 0.001)
    moved = straightened(scan, first_T_last)
    np.testing.assert_array_equal(moved.is_return, scan.is_return)
    assert np.isfinite(moved.angles_rad).all()


def test_a_laser_that_stood_saw_what_it_saw() -> None:
    scan = Scan(3, "laser", -2.0, 0.01, 0.1, 20.0, np.linspace(1, 5, 400).astype(np.float32), 0.0001)
    same = straightened(scan, np.eye(4))
    np.testing.assert_allclose(same.points_m, scan.points_m, atol=1e-6)
    np.testing.assert_allclose(same.angles_rad, scan.angles_rad, atol=1e-12)
