"""Legs: one foot at least stands still, steps alternate and have the length that belongs to the speed."""

import numpy as np
import pytest
from semap_ingest.simulation.gait import FEET_APART_M, LEFT, RIGHT, WALK_RATIO_MMIN, gait
from semap_ingest.simulation.motion import STEP_S, Motion, stand, turn, walk
from semap_ingest.simulation.way import evenly_spaced
from simulated import SEEDS, course

STRAIGHT = evenly_spaced(np.array([[0.0, 0.0], [12.0, 0.0]]))


def straight(speed_mps: float) -> Motion:
    here = np.zeros(2)
    walked = walk(STRAIGHT, 0.0, speed_mps)
    return stand(here, 0.0, 1.0).then(walked, stand(STRAIGHT[-1], 0.0, 1.0))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_foot_stands_still_at_any_time(seed: int) -> None:
    for walked in course(seed).gaits:
        moved_m = np.linalg.norm(np.diff(walked.shins_m, axis=0), axis=-1)
        assert (moved_m.min(axis=1) == 0).all()
        assert moved_m.max() / STEP_S < 7


@pytest.mark.parametrize("seed", SEEDS)
def test_shins_stay_below_the_body(seed: int) -> None:
    for person, walked in zip(course(seed).people, course(seed).gaits, strict=True):
        away_m = np.linalg.norm(walked.shins_m - person.motion.position_m[:, None], axis=-1)
        assert away_m.max() < 0.72
        assert np.isfinite(walked.shins_m).all()
        assert ((walked.swing >= 0) & (walked.swing <= 1)).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_phase_grows_and_rests_at_heel_strikes(seed: int) -> None:
    for person, walked in zip(course(seed).people, course(seed).gaits, strict=True):
        grown = np.diff(walked.phase_rad)
        assert (grown >= -1e-9).all()
        stands = np.linalg.norm(np.diff(person.motion.position_m, axis=0), axis=1) == 0
        stands &= np.diff(person.motion.heading_rad) == 0
        inner = np.flatnonzero(np.convolve(stands, np.ones(9), "same") == 9)
        turns = walked.phase_rad[inner] / np.pi
        assert turns == pytest.approx(np.round(turns), abs=1e-6)


@pytest.mark.parametrize("speed_mps", [0.8, 1.1, 1.4])
def test_step_length_follows_from_speed(speed_mps: float) -> None:
    """In the steady middle, by the walk ratio: v = length * cadence, length / cadence = const."""
    walked = gait(straight(speed_mps))
    middle = slice(len(walked.swing) // 3, 2 * len(walked.swing) // 3)
    foot_x = np.unique(
        np.round(walked.shins_m[middle, LEFT, 0][:-1][np.diff(walked.shins_m[middle, LEFT, 0]) == 0], 6)
    )
    expected_m = np.sqrt(60 * speed_mps * WALK_RATIO_MMIN)
    assert np.diff(foot_x) / 2 == pytest.approx(expected_m, rel=0.08)


def test_standing_feet_are_side_by_side() -> None:
    walked = gait(straight(1.2))
    assert walked.shins_m[0].tolist() == [[0.0, FEET_APART_M / 2], [0.0, -FEET_APART_M / 2]]
    assert walked.shins_m[-1, :, 0] == pytest.approx([12.0, 12.0], abs=0.2)
    assert walked.shins_m[-1, :, 1] == pytest.approx([FEET_APART_M / 2, -FEET_APART_M / 2])
    assert walked.swing[[0, -1]].tolist() == [0.0, 0.0]


def test_first_the_right_foot_swings_then_the_left() -> None:
    walked = gait(straight(1.2))
    moves = np.diff(walked.shins_m[..., 0], axis=0) > 0
    half = (walked.phase_rad[1:] // np.pi) % 2
    assert not (moves[:, RIGHT] & (half == 1)).any()
    assert not (moves[:, LEFT] & (half == 0)).any()


def test_turning_on_the_spot_takes_steps() -> None:
    here = np.array([3.0, 4.0])
    turned = stand(here, 0.0, 0.5).then(turn(here, 0.0, np.pi * 0.9), stand(here, np.pi * 0.9, 0.5))
    walked = gait(turned)
    assert walked.phase_rad[-1] >= 4 * np.pi
    assert np.linalg.norm(walked.shins_m - here, axis=-1).max() < FEET_APART_M
    assert walked.shins_m[-1].mean(axis=0) == pytest.approx(here, abs=0.03)


def test_nobody_moves_at_all() -> None:
    walked = gait(stand(np.zeros(2), 1.0, 3.0))
    assert (walked.phase_rad == 0).all()
    assert (np.diff(walked.shins_m, axis=0) == 0).all()
