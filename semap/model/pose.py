"""Where one frame stands in another."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Pose:
    """Translation [m] and unit quaternion (x y z w) of a child frame in its parent frame.

    Right-handed, REP 103: x forward, y left, z up. `parent_T_child` maps child points to the parent.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    qw: float = 1.0

    def matrix(self) -> NDArray[np.float64]:
        """parent_T_child, (4, 4) float64, homogeneous; the quaternion is normalised first."""
        length = math.hypot(self.qx, self.qy, self.qz, self.qw) or math.nan
        x, y, z, w = self.qx / length, self.qy / length, self.qz / length, self.qw / length
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), self.x_m],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), self.y_m],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), self.z_m],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )


IDENTITY = Pose()
