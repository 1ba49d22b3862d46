"""Images, as a camera or its driver gives them, and the camera model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Image:
    """pixels  (height, width, 3) uint8, red first"""

    stamp_us: int
    frame: str
    pixels: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class CompressedImage:
    """data  a whole JPEG or PNG file"""

    stamp_us: int
    frame: str
    data: bytes


@dataclass(frozen=True, eq=False)
class Camera:
    """How a camera sees, as sensor_msgs/CameraInfo says it.

    matrix      (3, 3), K [px]
    distortion  (k,), D: k1 k2 p1 p2 k3 ... of the model; empty or all zero where there is none
    projection  (3, 3), the left of P [px], of images that were rectified; None: it is not told
    """

    frame: str
    width_px: int
    height_px: int
    matrix: NDArray[np.float64]
    distortion: NDArray[np.float64]
    model: Literal["plumb_bob", "rational_polynomial", "equidistant"] = "plumb_bob"
    projection: NDArray[np.float64] | None = None

    def rectified(self) -> Camera | None:
        """How the images are seen that it has been taken out of; None where that is not told."""
        matrix = self.projection if self.projection is not None or self.distortion.any() else self.matrix
        if matrix is None:
            return None
        return replace(self, matrix=matrix, distortion=np.zeros(0), model="plumb_bob", projection=None)
