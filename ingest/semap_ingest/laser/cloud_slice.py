"""A slice of a cloud as the sweep of a 2D laser: in each direction the nearest point between two heights."""

from __future__ import annotations

import math

import numpy as np

from semap_ingest.sensing.scan import Cloud, Scan

BEAMS = 720
STEP_RAD = 2 * math.pi / BEAMS
FARTHEST_M = 100.0


def sliced(cloud: Cloud, low_m: float, high_m: float) -> Scan:
    """Half a degree between beams, all around; infinity where nothing is.

    low_m, high_m  in the cloud's own frame, along its z axis
    """
    x, y, z = cloud.points_m.astype(np.float64).T
    range_m = np.hypot(x, y)
    is_in = (z >= low_m) & (z <= high_m) & (range_m > 0) & (range_m <= FARTHEST_M)
    beam = np.floor((np.arctan2(y[is_in], x[is_in]) + math.pi) / STEP_RAD).astype(np.int64) % BEAMS
    nearest_m = np.full(BEAMS, np.inf)
    np.minimum.at(nearest_m, beam, range_m[is_in])
    return Scan(
        cloud.stamp_us,
        cloud.frame,
        -math.pi + STEP_RAD / 2,
        STEP_RAD,
        0.0,
        FARTHEST_M,
        nearest_m.astype(np.float32),
    )
