"""The 2D laser: each beam against one cast in plain Python at its own moment; the noise against its numbers."""

from dataclasses import replace
from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest
from semap_ingest.simulation.floor import office_floor
from semap_ingest.simulation.laser_view import (
    ANGLE_MIN_RAD,
    ANGLE_STEP_RAD,
    BEAM_S,
    BEAMS,
    DROPOUT_SHARE,
    RANGE_STD_M,
    SWEEP_S,
    LaserView,
    measured,
)
from semap_ingest.simulation.moment import Moment
from simulated import course

PLACE = (10.0, 5.15)
VIEW = LaserView(office_floor())


def cast(angle_rad: float, moment: Moment) -> float:
    """The range of one beam that the sensor takes at a moment, [rad, map]."""
    dx, dy = cos(angle_rad), sin(angle_rad)
    nearest = np.inf
    surfaces = office_floor().surfaces(moment.door_rad)
    for ((x0, y0), (x1, y1)), (low, high) in zip(surfaces.segments_m, surfaces.z_m, strict=True):
        across = dx * (y1 - y0) - dy * (x1 - x0)
        if not low <= 0.25 <= high or across == 0:
            continue
        bx, by = x0 - PLACE[0], y0 - PLACE[1]
        distance, along = (bx * (y1 - y0) - by * (x1 - x0)) / across, (bx * dy - by * dx) / across
        if distance > 0 and 0 <= along <= 1:
            nearest = min(nearest, distance)
    for body in moment.bodies:
        for x, y in body.shins_m:
            ahead = (x - PLACE[0]) * dx + (y - PLACE[1]) * dy
            beside = (y - PLACE[1]) * dx - (x - PLACE[0]) * dy
            if abs(beside) < body.shin_radius_m and ahead > 0:
                nearest = min(nearest, ahead - (body.shin_radius_m**2 - beside**2) ** 0.5)
    return float(nearest)


def test_layout_is_the_sensor_s() -> None:
    assert BEAMS == 811
    assert np.degrees(ANGLE_STEP_RAD) == pytest.approx(1 / 3)
    assert np.degrees(ANGLE_MIN_RAD + (BEAMS - 1) * ANGLE_STEP_RAD) == pytest.approx(135)
    assert pytest.approx(0.75 / 15) == SWEEP_S


def between(first: Moment, last: Moment, share: float) -> Moment:
    """Bodies on their straight way between two moments; leaves as at the first."""
    bodies = tuple(
        replace(begin, shins_m=begin.shins_m + share * (end.shins_m - begin.shins_m))
        for begin, end in zip(first.bodies, last.bodies, strict=True)
    )
    return replace(first, bodies=bodies)


@pytest.mark.parametrize("time_s", [12.0, 33.3, 61.7])
def test_beams_end_where_plain_python_says(time_s: float) -> None:
    """Each at its own time: legs move on during a sweep."""
    first, last = (course(1).at(each) for each in (time_s, time_s + SWEEP_S))
    last = replace(last, door_rad=first.door_rad)
    ranges = VIEW.sweep(first, last)
    for beam in range(0, BEAMS, 7):
        moment = between(first, last, beam / (BEAMS - 1))
        expected = cast(pi / 2 + ANGLE_MIN_RAD + beam * ANGLE_STEP_RAD, moment)
        assert ranges.true_m[beam] == pytest.approx(expected, abs=1e-9), beam


def test_moving_evenly_is_nearly_how_they_move() -> None:
    """In a sweep of 50 ms hardly a beam ends elsewhere than in the world of its own time."""
    differs = []
    for time_s in (12.0, 33.3, 61.7, 80.0):
        ranges = VIEW.sweep(course(1).at(time_s), course(1).at(time_s + SWEEP_S))
        for beam in range(0, BEAMS, 9):
            expected = cast(
                pi / 2 + ANGLE_MIN_RAD + beam * ANGLE_STEP_RAD, course(1).at(time_s + beam * BEAM_S)
            )
            differs.append(abs(ranges.true_m[beam] - expected) > 0.02)
    assert np.mean(differs) < 0.01


def test_a_leaf_that_moves_is_met_where_it_is_at_each_beam() -> None:
    happening = course(1)
    move = happening.moves[0]
    time_s = (move.start_s + move.end_s) / 2
    first, last = happening.at(time_s), happening.at(time_s + SWEEP_S)
    alone = [replace(moment, bodies=()) for moment in (first, last)]
    moving = VIEW.sweep(*alone).true_m
    hinge_m, _ = happening.floor.doors[move.door].leaf_m(0.0)
    middle = round(
        (atan2(hinge_m[1] - PLACE[1], hinge_m[0] - PLACE[0]) - pi / 2 - ANGLE_MIN_RAD) / ANGLE_STEP_RAD
    )
    window = range(max(0, middle - 15), min(BEAMS, middle + 15))
    frozen = VIEW.sweep(alone[0], alone[0]).true_m
    assert (np.abs(frozen - moving)[list(window)] > 0.002).any()
    for beam in window:
        moment = replace(happening.at(time_s + beam * BEAM_S), bodies=())
        expected = cast(pi / 2 + ANGLE_MIN_RAD + beam * ANGLE_STEP_RAD, moment)
        assert abs(moving[beam] - expected) < 0.01 or abs(moving[beam] - expected) > 0.3, beam


def test_shins_are_known_by_whose_they_are() -> None:
    happening = course(1)
    moment = happening.at(40.0)
    ranges = VIEW.sweep(moment, moment)
    for beam in np.flatnonzero(ranges.shin_of >= 0):
        angle = pi / 2 + ANGLE_MIN_RAD + beam * ANGLE_STEP_RAD
        end = np.array(PLACE) + ranges.true_m[beam] * np.array([cos(angle), sin(angle)])
        body = moment.bodies[ranges.shin_of[beam]]
        gap_m = min(hypot(*(end - shin_m)) for shin_m in body.shins_m)
        assert gap_m == pytest.approx(body.shin_radius_m)
    nobody = replace(moment, bodies=())
    assert (VIEW.sweep(nobody, nobody).shin_of == -1).all()


def test_noise_is_that_of_the_data_sheet() -> None:
    random = np.random.default_rng(5)
    drawn = np.array([measured(np.full(BEAMS, 4.0), random) for _ in range(100)]).astype(np.float64)
    came_back = np.isfinite(drawn)
    assert 1 - came_back.mean() == pytest.approx(DROPOUT_SHARE, rel=0.15)
    assert drawn[came_back].std() == pytest.approx(RANGE_STD_M, rel=0.02)
    assert drawn[came_back].mean() == pytest.approx(4.0, abs=0.001)
    in_mm = drawn[came_back] * 1000
    assert np.abs(in_mm - np.round(in_mm)).max() < 1e-3


def test_mixed_beams_lie_between_both_sides_of_an_edge() -> None:
    random = np.random.default_rng(5)
    edge = np.where(np.arange(BEAMS) < 400, 2.0, 6.0)
    drawn = np.array([measured(edge, random) for _ in range(400)])
    before, after = drawn[:, 398], drawn[:, 401]
    assert np.nanmax(np.abs(before[np.isfinite(before)] - 2.0)) < 0.1
    assert np.nanmax(np.abs(after[np.isfinite(after)] - 6.0)) < 0.1
    at_edge = drawn[:, 399][np.isfinite(drawn[:, 399])]
    mixed = (at_edge > 2.15) & (at_edge < 5.85)
    assert mixed.mean() == pytest.approx(0.2, abs=0.06)


@pytest.mark.parametrize("true_m", [np.inf, 30.0, 0.0, 0.01])
def test_nothing_comes_back_from_too_far_or_too_near(true_m: float) -> None:
    drawn = measured(np.full(BEAMS, true_m), np.random.default_rng(1))
    assert np.isinf(drawn).mean() > 0.95
