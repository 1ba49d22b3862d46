"""Clusters in their places: legs stir, things do not, and a laser that moves tells neither."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from semap_ingest.laser.stirring import Stirring
from semap_ingest.sensing.clusters import LegClusters

STOOD = np.eye(4)
NOISE_M = 0.006


def clusters(stamp_us: int, centre_m: NDArray[np.float64], score: float) -> LegClusters:
    count = len(centre_m)
    return LegClusters(
        stamp_us,
        "laser",
        centre_m,
        np.tile(1e-4 * np.eye(2), (count, 1, 1)),
        np.full(count, score),
        np.full(count, 0.1),
        np.full(count, 5, np.int64),
    )


def told(
    rate_hz: float,
    seconds: float,
    swing_m: float,
    score: float,
    pose: Callable[[float], NDArray[np.float64]] = lambda time_s: STOOD,
    noise_m: float = NOISE_M,
) -> list[float]:
    """Scores of a leg 3 m away that swings so far to and fro, once in four seconds, scan by scan."""
    stirring, dice, said = Stirring(), np.random.default_rng(round(10 * rate_hz)), []
    for time_s in np.arange(0.0, seconds, 1 / rate_hz):
        place_m = np.array([[3.0 + swing_m * np.sin(np.pi / 2 * time_s), 0.5]])
        place_m += dice.normal(0, noise_m, (1, 2))
        said.append(float(stirring.scores(clusters(round(1e6 * time_s), place_m, score), pose(time_s))[0]))
    return said


@pytest.mark.parametrize(("rate_hz", "noise_m"), [(5.0, 0.003), (7.5, 0.004), (15.0, 0.006), (40.0, 0.008)])
def test_what_never_stirs_is_hardly_a_leg_after_a_while_at_any_rate(rate_hz: float, noise_m: float) -> None:
    said = told(rate_hz, 25.0, 0.0, 0.9, noise_m=noise_m)
    assert min(said[: round(4 * rate_hz)]) >= 0.9
    assert np.mean(said[round(20 * rate_hz) :]) < 0.5


@pytest.mark.parametrize("rate_hz", [5.0, 7.5, 15.0, 40.0])
def test_who_stands_and_sways_by_a_centimetre_is_a_leg_for_a_minute(rate_hz: float) -> None:
    assert min(told(rate_hz, 60.0, 0.014, 0.7)) >= 0.7


@pytest.mark.parametrize("rate_hz", [5.0, 7.5])
def test_where_noise_hides_whether_it_stirs_nothing_speaks_against_a_leg(rate_hz: float) -> None:
    assert min(told(rate_hz, 60.0, 0.0, 0.8, noise_m=0.02)) >= 0.8


def test_what_hardly_stirs_says_nothing_while_the_laser_drives_or_turns() -> None:
    def drives(time_s: float) -> NDArray[np.float64]:
        pose = np.eye(4)
        pose[0, 3] = 0.5 * time_s
        return pose

    def turns(time_s: float) -> NDArray[np.float64]:
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(time_s), -np.sin(time_s)], [np.sin(time_s), np.cos(time_s)]]
        return pose

    for pose in (drives, turns):
        np.testing.assert_allclose(told(15.0, 25.0, 0.0, 0.9, pose), 0.9)


def test_a_laser_that_stops_finds_things_out_again() -> None:
    def stops(time_s: float) -> NDArray[np.float64]:
        pose = np.eye(4)
        pose[0, 3] = 0.5 * min(time_s, 20.0)
        return pose

    said = told(15.0, 45.0, 0.0, 0.9, stops)
    np.testing.assert_allclose(said[: 15 * 20], 0.9)
    assert np.mean(said[15 * 40 :]) < 0.5


def test_who_walks_by_is_told_from_nothing_that_stands_there() -> None:
    """A post that never stirs beside a way, and somebody who walks it again and again."""
    stirring, dice = Stirring(), np.random.default_rng(1)
    walkers, posts = [], []
    for scan in range(15 * 40):
        time_s = scan / 15
        places_m = np.array([[-4 + (1.2 * time_s) % 8.0, 1.0], [2.0, 1.4]]) + dice.normal(0, NOISE_M, (2, 2))
        walker, post = stirring.scores(clusters(round(1e6 * time_s), places_m, 0.8), STOOD)
        walkers.append(walker)
        posts.append(post)
    assert min(walkers) >= 0.8
    assert np.mean(posts[15 * 20 :]) < 0.5


def test_no_clusters_are_none() -> None:
    stirring = Stirring()
    for stamp_us in range(0, 10_000_000, 100_000):
        assert len(stirring.scores(clusters(stamp_us, np.zeros((0, 2)), 0.5), STOOD)) == 0
