"""What may be a leg in a scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class LegClusters:
    """Clusters of one scan, all of them, also those that are hardly a leg.

    centre_m       (n, 2) [m, frame]: estimate of the leg's axis, not of its visible face
    covariance_m2  (n, 2, 2) of the centre
    score          (n,) probability that it is a leg (or both legs in one)
    width_m        (n,) first to last point
    points         (n,) int64, how many
    """

    stamp_us: int
    frame: str
    centre_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    score: NDArray[np.float64]
    width_m: NDArray[np.float64]
    points: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.centre_m)
