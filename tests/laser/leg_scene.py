"""Scans of round legs before flat walls, cast exactly."""

import numpy as np
from numpy.typing import NDArray
from semap_ingest.sensing.scan import Scan

STEP_RAD = float(np.radians(0.33))
BEAMS = 819
FIRST_RAD = -np.pi * 0.75


def scan_of(ranges_m: object, step_rad: float = STEP_RAD, first_rad: float = FIRST_RAD) -> Scan:
    return Scan(0, "laser", first_rad, step_rad, 0.05, 25.0, np.asarray(ranges_m, np.float32))


def cast(
    legs_m: NDArray[np.float64],
    radius_m: float = 0.065,
    wall_m: float = np.inf,
    noise_m: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Scan:
    """Circles at legs_m (n, 2) inside a round wall around the laser."""
    angle = FIRST_RAD + STEP_RAD * np.arange(BEAMS)
    beams = np.column_stack([np.cos(angle), np.sin(angle)])
    ranges = np.full(BEAMS, wall_m)
    for leg in np.reshape(legs_m, (-1, 2)):
        along = beams @ leg
        inside = along**2 - (leg @ leg - radius_m**2)
        is_hit = (inside >= 0) & (along > 0)
        ranges = np.minimum(ranges, np.where(is_hit, along - np.sqrt(np.maximum(inside, 0)), np.inf))
    if rng is not None:
        ranges = ranges + rng.normal(0, noise_m, BEAMS)
    return scan_of(ranges)
