"""A person as a footprint: how long and wide the body is, and where it faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Body:
    """What is known of a body before it is seen, and how well a detection shows it.

    extent_m, extent_std_m  length (along the way it walks) and width, and how much bodies differ
    measured_std_m          of one detection's extent
    drift_std_m             by how much what is measured may change within a second
    least_m, largest_m      what a body can be
    walking_mps             from which speed on the velocity tells where it faces,
    walking_std             if it is also so many standard deviations of the velocity
    """

    extent_m: tuple[float, float] = (0.35, 0.5)
    extent_std_m: float = 0.08
    measured_std_m: float = 0.15
    drift_std_m: float = 0.02
    least_m: float = 0.2
    largest_m: float = 1.0
    walking_mps: float = 0.3
    walking_std: float = 2.0


def first_extent(measured_m: Floats, body: Body) -> tuple[Floats, Floats]:
    """Extent (n, 2) and its variance, from the prior and the first detection; NaN: not measured."""
    prior_m = np.tile(np.asarray(body.extent_m, np.float64), (len(measured_m), 1))
    return next_extent(prior_m, np.full(prior_m.shape, body.extent_std_m**2), measured_m, 0.0, body)


def next_extent(
    extent_m: Floats, variance_m2: Floats, measured_m: Floats, step_s: Floats | float, body: Body
) -> tuple[Floats, Floats]:
    """One Kalman step for each side by itself; NaN: not measured.

    step_s  (n, 1) since the extent was last measured, or one for all
    """
    variance_m2 = variance_m2 + body.drift_std_m**2 * step_s
    gain = np.where(np.isnan(measured_m), 0.0, variance_m2 / (variance_m2 + body.measured_std_m**2))
    measured_m = np.clip(np.where(np.isnan(measured_m), extent_m, measured_m), body.least_m, body.largest_m)
    return extent_m + gain * (measured_m - extent_m), (1 - gain) * variance_m2


def heading(heading_rad: Floats, mean: Floats, covariance: Floats, body: Body) -> Floats:
    """Where each faces: along its velocity while it surely walks, and as before when it does not.

    heading_rad  (n,) before
    """
    speed_mps = np.hypot(mean[:, 2], mean[:, 3])
    std_mps = np.sqrt((covariance[:, 2, 2] + covariance[:, 3, 3]) / 2)
    walks = speed_mps > np.maximum(body.walking_mps, body.walking_std * std_mps)
    return np.where(walks, np.arctan2(mean[:, 3], mean[:, 2]), heading_rad)
