"""Smoothing of many tracks at once against filterpy, one track at a time."""

from __future__ import annotations

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from semap.batch.smoothing import Motion, pieces, smooth

MOTION = Motion()


def by_filterpy(stamp_us: np.ndarray, position_m: np.ndarray, std_m: np.ndarray) -> np.ndarray:
    """The smoothed positions of one piece, on each axis by itself, and their standard deviations."""
    n = len(stamp_us)
    found = np.empty((n, 3))
    steps_s = np.concatenate([[0.0], np.diff(stamp_us) / 1e6])
    Fs = [np.array([[1, dt], [0, 1]]) for dt in steps_s]
    Qs = [
        Q_continuous_white_noise(2, dt, MOTION.acceleration_density) if dt else np.zeros((2, 2))
        for dt in steps_s
    ]
    for axis in range(2):
        kf = KalmanFilter(dim_x=2, dim_z=1)
        kf.H = np.array([[1.0, 0]])
        kf.x = np.array([[position_m[0, axis]], [0]])
        kf.P = np.diag([std_m[0] ** 2, MOTION.speed_std_mps**2])
        xs, Ps = [kf.x.copy()], [kf.P.copy()]
        for k in range(1, n):
            kf.predict(F=Fs[k], Q=Qs[k])
            kf.update(position_m[k, axis], R=std_m[k] ** 2)
            xs.append(kf.x.copy())
            Ps.append(kf.P.copy())
        # filterpy's smoother takes the step from k to k + 1 at place k + 1
        smoothed, covariance, *_ = kf.rts_smoother(np.array(xs), np.array(Ps), Fs=Fs, Qs=Qs)
        found[:, axis] = smoothed[:, 0, 0]
        found[:, 2] = np.sqrt(covariance[:, 0, 0])
    return found


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.lists(st.integers(1, 20), min_size=1, max_size=6))
def test_each_track_is_smoothed_as_by_filterpy(seed: int, lengths: list[int]) -> None:
    random = np.random.default_rng(seed)
    track = np.repeat(np.arange(len(lengths)), lengths)
    stamp_us = np.concatenate([np.cumsum(random.integers(1_000, 1_900_000, n)) for n in lengths])
    position_m = random.normal(0, 5, (len(track), 2))
    std_m = random.uniform(0.05, 0.5, len(track))
    piece = pieces(track, stamp_us, MOTION)
    assert piece.tolist() == track.tolist()
    found = np.column_stack(smooth(piece, stamp_us, position_m, std_m, MOTION))
    for n in range(len(lengths)):
        of_track = track == n
        wanted = by_filterpy(stamp_us[of_track], position_m[of_track], std_m[of_track])
        np.testing.assert_allclose(found[of_track], wanted, atol=1e-6)


def test_a_long_pause_parts_a_track() -> None:
    stamp_us = np.array([0, 2_000_000, 4_000_001, 5_000_000, 0])
    assert pieces(np.array([0, 0, 0, 0, 1]), stamp_us, MOTION).tolist() == [0, 0, 1, 1, 2]
    assert pieces(np.zeros(0, np.int64), np.zeros(0, np.int64), MOTION).tolist() == []


def test_noise_shrinks_and_the_unknown_noise_is_the_usual_one() -> None:
    random = np.random.default_rng(1)
    stamp_us = np.arange(200) * 66_667
    true_m = np.stack([stamp_us / 1e6 * 1.2, np.full(200, 3.0)], axis=1)
    measured_m = true_m + random.normal(0, MOTION.std_m, true_m.shape)
    unknown = np.full(200, np.nan)
    piece = np.zeros(200, np.int64)
    found, std_m = smooth(piece, stamp_us, measured_m, unknown, MOTION)
    np.testing.assert_array_equal(
        found, smooth(piece, stamp_us, measured_m, np.full(200, MOTION.std_m), MOTION)[0]
    )
    assert (std_m < MOTION.std_m).all()
    assert np.sqrt(np.mean((found - true_m) ** 2)) < 0.5 * MOTION.std_m
