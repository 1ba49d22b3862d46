"""Persons seen at one moment, by one sensor or by both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

CAMERA = 1
LASER = 2
BOTH = CAMERA | LASER


@dataclass(frozen=True, eq=False)
class Detections:
    """Persons in one frame at one moment.

    position_m     (n, 2) [m, frame]: the middle of the body on the floor
    covariance_m2  (n, 2, 2)
    score          (n,) probability that it is a person
    seen_by        (n,) uint8: CAMERA, LASER or BOTH
    extent_m       (n, 2) length and width of the body's footprint, length along the way it walks; NaN:
                   unknown
    image_track    (n,) int64, the image track of its box; -1: none
    """

    stamp_us: int
    frame: str
    position_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    score: NDArray[np.float64]
    seen_by: NDArray[np.uint8]
    extent_m: NDArray[np.float64]
    image_track: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.position_m)
