"""Tracks smoothed over their whole length.

Constant velocity with white-noise acceleration, forward by a Kalman filter and back by the smoother of Rauch,
Tung and Striebel (1965). Both axes have the same noise, so that one 2 x 2 covariance serves both. Forward
the steps are taken one after the other, each for all tracks at once; back, filterpy takes track after track.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.common import Q_continuous_white_noise, kinematic_state_transition
from filterpy.kalman import rts_smoother
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """How tracks move and are measured.

    acceleration_density  of the white noise of acceleration [m^2/s^3]
    std_m                 of a measured position on each axis, where a state has none of its own
    speed_std_mps         of the unknown first velocity on each axis
    longest_gap_s         a longer pause parts a track: nothing is known of the way between
    """

    acceleration_density: float = 0.5
    std_m: float = 0.1
    speed_std_mps: float = 2.0
    longest_gap_s: float = 2.0


def pieces(track: NDArray[np.int64], stamp_us: NDArray[np.int64], motion: Motion) -> NDArray[np.int64]:
    """The piece that each state belongs to, ascending from 0.

    track, stamp_us  (n,) sorted by track, then by stamp
    """
    if len(track) == 0:
        return np.zeros(0, np.int64)
    parted = (np.diff(track) != 0) | (np.diff(stamp_us) > motion.longest_gap_s * 1e6)
    return np.concatenate([[0], np.cumsum(parted)])


def smooth(
    piece: NDArray[np.int64],
    stamp_us: NDArray[np.int64],
    position_m: Floats,
    std_m: Floats,
    motion: Motion,
) -> tuple[Floats, Floats]:
    """The most likely positions given all states of a piece, and how exactly they are known.

    piece       (n,) as of `pieces`; stamps ascend strictly within each
    position_m  (n, 2) measured [m, map frame]
    std_m       (n,) of each; NaN where unknown
    returns     (n, 2) [m, map frame], and (n,) the standard deviation on each axis [m]
    """
    if len(piece) == 0:
        return position_m.copy(), std_m.copy()
    first, length = _runs(piece)
    order = np.argsort(-length, kind="stable")
    first, length = first[order], length[order]
    # at step k the first active[k] pieces, the longest, still have a state
    active = np.searchsorted(-length, -np.arange(length[0]), side="left")
    variance = np.where(np.isnan(std_m), motion.std_m, std_m) ** 2
    step_s = np.concatenate([[0.0], np.diff(stamp_us) / 1e6])
    step_s[first] = 0.0
    transition, noise = _moves(step_s, motion.acceleration_density)
    states = np.zeros((len(piece), 2, 2))  # position and velocity by axis
    covariances = np.zeros((len(piece), 2, 2))
    for k, count in enumerate(active):
        at = first[:count] + k
        if k == 0:
            states[at, 0] = position_m[at]
            covariances[at, 0, 0] = variance[at]
            covariances[at, 1, 1] = motion.speed_std_mps**2
            continue
        move = transition[at]
        state = move @ states[at - 1]
        covariance = move @ covariances[at - 1] @ np.swapaxes(move, 1, 2) + noise[at]
        gain = covariance[:, :, 0] / (covariance[:, 0, 0] + variance[at])[:, None]
        states[at] = state + gain[:, :, None] * (position_m[at] - state[:, 0])[:, None, :]
        covariances[at] = covariance - gain[:, :, None] * covariance[:, None, 0, :]
    for begin, count in zip(first, length, strict=True):
        of_piece, steps = slice(begin, begin + count), slice(begin + 1, begin + count)
        states[of_piece], covariances[of_piece], *_ = rts_smoother(
            states[of_piece], covariances[of_piece], transition[steps], noise[steps]
        )
    return states[:, 0], np.sqrt(covariances[:, 0, 0])


def _runs(piece: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where each piece begins, and how many states it has."""
    first = np.flatnonzero(np.concatenate([[True], np.diff(piece) != 0]))
    return first, np.diff(np.concatenate([first, [len(piece)]]))


def _moves(step_s: Floats, density: float) -> tuple[Floats, Floats]:
    """(n, 2, 2) how position and velocity go on in each step, and the noise that comes to them.

    The noise is that of one second, its position scaled with the time to the 3/2, its velocity to the 1/2.
    """
    transition = np.tile(kinematic_state_transition(1, 1.0), (len(step_s), 1, 1))
    transition[:, 0, 1] = step_s
    scale = np.sqrt(np.stack([step_s**3, step_s], axis=1))
    of_second = Q_continuous_white_noise(2, 1.0, density)
    return transition, of_second * scale[:, :, None] * scale[:, None, :]
