"""Lines found in scans, against the walls that the scans were cast from, and in real scans."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from cast import cast, polygon
from data_sets import data_set
from hypothesis import given, settings
from hypothesis import strategies as st
from semap_ingest.lines.segments import LineSettings, find_lines, transform_lines
from semap_ingest.sensing.lines import Lines
from semap_ingest.sensing.scan import Scan

L_ROOM = polygon([(-3, -2), (5, -2), (5, 1), (4, 1), (4, 4), (-3, 4)])
EXACT = LineSettings(range_std_m=1e-4, flatness_m=1e-4)


def planar(x: float, y: float, yaw: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
    matrix[:2, 3] = x, y
    return matrix


def wall_of(ends: np.ndarray, walls) -> int:
    """The wall that both ends lie nearest to, and how far they are off its line."""
    return min(range(len(walls)), key=lambda i: _off(ends, walls[i]))


def _off(ends: np.ndarray, wall) -> float:
    line = shapely.LineString(wall)
    return max(line.distance(shapely.Point(end)) for end in ends)


@pytest.mark.parametrize("pose", [(0, 0, 0), (1, 0.5, 2.0), (-2, 3, -1.1), (3.5, -1, 3.0)])
def test_walls_are_found_as_they_are(pose) -> None:
    lines = transform_lines(find_lines(cast(L_ROOM, pose), EXACT), planar(*pose), "map")
    assert lines.frame == "map"
    found = [wall_of(ends, L_ROOM) for ends in lines.ends_m]
    assert len(set(found)) == len(found) >= 3
    for ends, wall in zip(lines.ends_m, found, strict=True):
        assert _off(ends, L_ROOM[wall]) < 1e-3
    # whatever is seen of a wall with 25 beams or more over 0.3 m or more is found
    scan = cast(L_ROOM, pose)
    points = scan.points_m @ planar(*pose)[:2, :2].T + planar(*pose)[:2, 3]
    for place, wall in enumerate(L_ROOM):
        near = points[shapely.distance(shapely.LineString(wall), shapely.points(points)) < 1e-3]
        if len(near) >= 25 and np.ptp(near, axis=0).max() > 0.3:
            assert place in found


def clockwise(scan: Scan) -> Scan:
    """The same sweep of a laser that turns the other way."""
    return replace(
        scan,
        angle_min_rad=float(scan.angles_rad[-1]),
        angle_step_rad=-scan.angle_step_rad,
        ranges_m=scan.ranges_m[::-1],
    )


@pytest.mark.parametrize("turns_clockwise", [False, True])
@pytest.mark.parametrize("pose", [(0, 0, 0), (1, 0.5, 2.0), (-2, 3, -1.1)])
def test_a_laser_that_hangs_upside_down_sees_the_same_walls(pose, turns_clockwise: bool) -> None:
    upright = cast(L_ROOM, pose)
    # its left is the right of one that stands upright; the field of view is symmetric
    hanging = replace(upright, ranges_m=upright.ranges_m[::-1])
    roll = np.diag([1.0, -1.0, -1.0, 1.0])
    scan = clockwise(hanging) if turns_clockwise else hanging
    lines = transform_lines(find_lines(scan, EXACT), planar(*pose) @ roll, "map")
    found = [wall_of(ends, L_ROOM) for ends in lines.ends_m]
    assert max(_off(ends, L_ROOM[wall]) for ends, wall in zip(lines.ends_m, found, strict=True)) < 1e-3
    seen = transform_lines(find_lines(upright, EXACT), planar(*pose), "map")
    assert set(found) == {wall_of(ends, L_ROOM) for ends in seen.ends_m}


def test_a_laser_that_turns_clockwise_sees_the_same_lines() -> None:
    scan = cast(L_ROOM, noise_m=0.015, dropout=0.02)
    one, other = find_lines(scan), find_lines(clockwise(scan))
    np.testing.assert_allclose(other.ends_m, one.ends_m, atol=1e-9)
    np.testing.assert_allclose(other.angle_std_rad, one.angle_std_rad)
    np.testing.assert_array_equal(other.points, one.points)


def test_what_a_driver_says_for_nothing_is_no_point() -> None:
    """Zero or infinity where nothing came back, with limits that let it pass."""
    scan = cast(L_ROOM, noise_m=0.015, dropout=0.1)
    expected = find_lines(scan)
    for nothing in (0.0, np.inf):
        ranges = np.where(scan.is_return, scan.ranges_m, nothing).astype(np.float32)
        found = find_lines(replace(scan, range_min_m=0.0, range_max_m=np.inf, ranges_m=ranges))
        np.testing.assert_array_equal(found.ends_m, expected.ends_m)


@pytest.mark.parametrize(("pitch_deg", "kept"), [(0, [0, 1]), (50, [0, 1]), (70, [1]), (90, [1])])
def test_a_line_that_goes_up_is_left_out(pitch_deg: float, kept: list[int]) -> None:
    """One along the axis that is tilted, one along the axis that it is tilted about."""
    lines = Lines(
        0,
        "laser",
        np.array([[[1.0, 0], [3, 0]], [[2, -1], [2, 1]]]),
        np.array([0.01, 0.02]),
        np.array([0.003, 0.004]),
        np.array([20, 30]),
    )
    pitch = math.radians(pitch_deg)
    tilted = np.eye(4)
    tilted[:3, :3] = [
        [math.cos(pitch), 0, math.sin(pitch)],
        [0, 1, 0],
        [-math.sin(pitch), 0, math.cos(pitch)],
    ]
    seen = transform_lines(lines, tilted, "map")
    np.testing.assert_allclose(seen.ends_m, lines.ends_m[kept] * [math.cos(pitch), 1], atol=1e-12)
    assert seen.points.tolist() == lines.points[kept].tolist()
    assert seen.offset_std_m.tolist() == lines.offset_std_m[kept].tolist()


def test_errors_are_as_large_as_the_covariance_says() -> None:
    """Of 300 noisy scans of one wall, seen at a slant: squared errors over variances are 1 on average."""
    wall = ((-1.0, 2.0), (2.5, 1.2))
    truth = math.atan2(-0.8, 3.5)
    turned, aside = [], []
    for seed in range(300):
        lines = find_lines(cast([wall], (0, 0, 1.5), 0.015, seed), LineSettings(flatness_m=0))
        (ends,) = transform_lines(lines, planar(0, 0, 1.5), "map").ends_m
        direction = ends[1] - ends[0]
        error = (math.atan2(*direction[::-1]) - truth + math.pi / 2) % math.pi - math.pi / 2
        turned.append(error / lines.angle_std_rad[0])
        middle = ends.mean(axis=0) - np.array(wall[0])
        aside.append((middle @ (math.sin(truth), -math.cos(truth))) / lines.offset_std_m[0])
    for normalised in (turned, aside):
        # a line is fitted at the points that were measured, which lie nearer than they are by curvature of 1e-4 m
        assert 0.75 < np.mean(np.square(normalised)) < 1.3
        assert abs(np.mean(normalised)) < 0.25


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("incidence_deg", [30, 45, 60])
def test_a_leaf_8_cm_back_in_its_wall_is_a_line_of_its_own(incidence_deg: float, seed: int) -> None:
    yaw = math.radians(incidence_deg)
    pose = (-4 * math.cos(yaw), -4 * math.sin(yaw), yaw)
    wall = [
        ((-3, 0), (-0.45, 0)),
        ((-0.45, 0), (-0.45, 0.08)),
        ((0.45, 0.08), (0.45, 0)),
        ((0.45, 0), (3, 0)),
    ]
    leaf = ((-0.45, 0.08), (0.45, 0.08))
    scan = cast([*wall, leaf], pose, noise_m=0.015, seed=seed, dropout=0.01)
    lines = transform_lines(find_lines(scan), planar(*pose), "map")
    middles = lines.ends_m.mean(axis=1)
    (door,) = np.flatnonzero(np.abs(middles[:, 1] - 0.08) < 0.03)
    ends = lines.ends_m[door]
    assert np.ptp(ends[:, 0]) > 0.55
    assert np.abs(ends[:, 0]).max() < 0.55
    assert (
        abs(math.atan((ends[1, 1] - ends[0, 1]) / (ends[1, 0] - ends[0, 0]))) < 4 * lines.angle_std_rad[door]
    )
    assert lines.angle_std_rad[door] < math.radians(1.2)
    others = np.delete(lines.ends_m, door, axis=0)
    assert np.abs(others[:, :, 1]).max() < 0.03


def test_legs_and_round_things_are_no_lines() -> None:
    def circle(x: float, y: float, radius: float):
        around = np.linspace(0, 2 * np.pi, 40)[:-1]
        return polygon([(x + radius * math.cos(a), y + radius * math.sin(a)) for a in around])

    clutter = [*circle(2, 0.2, 0.06), *circle(2, -0.15, 0.06), *circle(1.5, -2, 0.15)]
    for seed in range(5):
        assert len(find_lines(cast(clutter, noise_m=0.01, seed=seed))) == 0


def test_a_wall_behind_a_leg_is_one_line() -> None:
    wall, leg = ((3, -2), (3, 2)), polygon([(2.0, 0.0), (2.1, 0.0), (2.1, 0.1), (2.0, 0.1)])
    (ends,) = find_lines(cast([wall, *leg], noise_m=0.015)).ends_m
    assert np.hypot(*(ends[1] - ends[0])) == pytest.approx(4, abs=0.1)


readings = st.lists(
    st.one_of(st.sampled_from([0.0, np.inf, -np.inf, np.nan, 1e30, -1.0]), st.floats(0, 30)), max_size=60
)


@settings(deadline=None)
@given(readings, st.floats(-0.1, 0.1))
def test_whatever_comes_gives_lines_that_are_finite(ranges: list[float], step_rad: float) -> None:
    scan = Scan(1, "laser", -2.0, step_rad, 0.05, 25.0, np.array(ranges, dtype=np.float32))
    lines = find_lines(scan)
    assert lines.ends_m.shape == (len(lines), 2, 2)
    for values in (lines.ends_m, lines.angle_std_rad, lines.offset_std_m):
        assert np.isfinite(values).all()
    assert (lines.points >= 5).all()
    assert (np.hypot(*(lines.ends_m[:, 1] - lines.ends_m[:, 0]).T) >= 0.25).all()


def flat_scans():
    """Every tenth scan that has a pose: the scan, and map_T_laser as the data set tells it."""
    folder = data_set("flat")
    poses = [
        [float(row[key]) for key in ("ts", "x", "y", "heading")]
        for row in csv.DictReader((folder / "test_robot_df.csv").read_text().splitlines())
    ]
    stamps = np.array([pose[0] / 1e9 for pose in poses])
    text = (folder / "test_robot_scan.txt").read_text()
    for stamp, angles, ranges in re.findall(r"(\d+\.\d+)\s*\[([^\]]*)\]\s*\[([^\]]*)\]", text)[::10]:
        if not stamps[0] <= float(stamp) <= stamps[-1]:
            continue
        _, x, y, heading = poses[int(np.abs(stamps - float(stamp)).argmin())]
        beam = np.radians(np.array(angles.split(), dtype=np.float64) / 1e3 + 180)
        step = math.radians(0.85)
        count = round(2 * math.pi / step)
        regular = np.zeros(count, dtype=np.float32)
        regular[np.round((beam - beam[0]) % (2 * math.pi) / step).astype(int) % count] = (
            np.array(ranges.split(), dtype=np.float64) / 100
        )
        yield Scan(0, "laser", float(beam[0]), step, 0.1, 10.0, regular), (x, y, heading)


def test_lines_of_real_scans_lie_along_the_walls() -> None:
    """The poses are off by up to half a metre and furniture stands about; the walls are along the axes."""
    rows = csv.DictReader((data_set("flat") / "layout.csv").read_text().splitlines())
    layout = np.array([[float(row["x"]), float(row["y"])] for row in rows])
    walls = list(pairwise(layout))
    total_m = aligned_m = 0.0
    along_m = {0: 0.0, 90: 0.0, 270: 0.0}
    for scan, (x, y, heading) in flat_scans():
        found = find_lines(scan)
        for turn_deg in along_m:
            lines = transform_lines(found, planar(x, y, heading + math.radians(turn_deg)), "map")
            along_m[turn_deg] += _length_along(lines, walls)
            if turn_deg == 0:
                apart = lines.ends_m[:, 1] - lines.ends_m[:, 0]
                length = np.hypot(*apart.T)
                slant = (np.degrees(np.arctan2(apart[:, 1], apart[:, 0])) + 45) % 90 - 45
                total_m += length.sum()
                aligned_m += length[np.abs(slant) < 7].sum()
    assert total_m > 300
    assert aligned_m / total_m > 0.6  # by chance 0.16
    assert along_m[0] > 2.5 * max(along_m[90], along_m[270])


def _length_along(lines: Lines, walls) -> float:
    """Length [m] of the lines that lie within 0.3 m and 7 degrees of a wall."""
    sum_m = 0.0
    for first, second in lines.ends_m:
        for start, end in walls:
            length = np.hypot(*(end - start))
            if length < 0.1:
                continue
            direction = (end - start) / length
            offsets = [direction[0] * (p - start)[1] - direction[1] * (p - start)[0] for p in (first, second)]
            reach = ((first + second) / 2 - start) @ direction
            apart = np.hypot(*(second - first))
            if (
                max(map(abs, offsets)) < 0.3
                and 0 < reach < length
                and abs(offsets[1] - offsets[0]) < 0.12 * apart
            ):
                sum_m += apart
                break
    return sum_m
