"""Kalman filters of many tracks at once, each with constant velocity.

A state of `a` axes is [positions (a), velocities (a)]. Between two stamps the acceleration on each axis
is white noise of a given density (Bar-Shalom, Li and Kirubarajan 2001, eq. 6.2.2-5: continuous white
noise acceleration), so that a step may be of any length, and two steps are the same as one of both
together. The models are filterpy's. What is measured is the positions of all axes, in their order.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.common import Q_continuous_white_noise, kinematic_state_transition
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gaussians:
    """mean (n, 2a), covariance (n, 2a, 2a)"""

    mean: Floats
    covariance: Floats

    def __len__(self) -> int:
        return len(self.mean)


@dataclass(frozen=True, eq=False)
class Distances:
    """Of measurements from where tracks are expected.

    squared          (n, m) Mahalanobis distance squared, chi-square distributed with two degrees of freedom
    log_determinant  (n, m) of the innovation's covariance
    """

    squared: Floats
    log_determinant: Floats


def predict(states: Gaussians, step_s: float, density: Floats | float) -> Gaussians:
    """Where the tracks are `step_s` later.

    density  (n,) or one for all: power spectral density of the acceleration on each axis [m^2/s^3; px^2/s^3]
    """
    axes = states.mean.shape[1] // 2
    transition = np.kron(kinematic_state_transition(1, step_s), np.eye(axes))
    noise = Q_continuous_white_noise(2, step_s, 1.0, axes, order_by_dim=False)
    covariance = transition @ states.covariance @ transition.T
    covariance += np.asarray(density, np.float64)[..., None, None] * noise
    return Gaussians(states.mean @ transition.T, covariance)


def distances(states: Gaussians, measured: Floats, covariance: Floats) -> Distances:
    """Each of n tracks of two axes against each of m measurements.

    measured    (m, 2)
    covariance  (m, 2, 2), or (n, m, 2, 2) where it depends on the track
    """
    x, y = np.moveaxis(measured[None, :, :] - states.mean[:, None, :2], 2, 0)
    innovation = states.covariance[:, None, :2, :2] + covariance
    xx, xy, yy = innovation[..., 0, 0], innovation[..., 0, 1], innovation[..., 1, 1]
    determinant = xx * yy - xy * xy
    squared = (yy * x * x - 2 * xy * x * y + xx * y * y) / determinant
    return Distances(squared, np.log(determinant))


def less_certain(states: Gaussians, which: NDArray[np.bool_], std_m: float) -> Gaussians:
    """The same with the positions of some known worse than was thought: their motion is not to blame.

    which  (n,)
    """
    if not which.any():
        return states
    axes = states.mean.shape[1] // 2
    covariance = states.covariance.copy()
    covariance[which, :axes, :axes] += std_m**2 * np.eye(axes)
    return Gaussians(states.mean, covariance)


def update(states: Gaussians, measured: Floats, covariance: Floats) -> Gaussians:
    """n tracks, each with its own measurement; in Joseph's form, which stays positive definite.

    measured    (n, a)
    covariance  (n, a, a)
    """
    axes = measured.shape[1]
    innovation = states.covariance[:, :axes, :axes] + covariance
    gain = states.covariance[:, :, :axes] @ np.linalg.inv(innovation)
    mean = states.mean + (gain @ (measured - states.mean[:, :axes])[:, :, None])[:, :, 0]
    rest = np.tile(np.eye(states.mean.shape[1]), (len(gain), 1, 1))
    rest[:, :, :axes] -= gain
    updated = rest @ states.covariance @ _transposed(rest) + gain @ covariance @ _transposed(gain)
    return Gaussians(mean, (updated + _transposed(updated)) / 2)


def _transposed(matrices: Floats) -> Floats:
    return np.swapaxes(matrices, 1, 2)
