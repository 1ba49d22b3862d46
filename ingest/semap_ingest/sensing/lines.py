"""Straight lines in a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Lines:
    """Segments in one scan.

    ends_m        (n, 2, 2): two ends, each x and y [m, frame]
    angle_std_rad (n,) standard deviation of the direction [rad]
    offset_std_m  (n,) standard deviation across the line at its middle
    points        (n,) int64, how many points it was fitted to
    """

    stamp_us: int
    frame: str
    ends_m: NDArray[np.float64]
    angle_std_rad: NDArray[np.float64]
    offset_std_m: NDArray[np.float64]
    points: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ends_m)
