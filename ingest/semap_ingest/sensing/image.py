"""Images, as a camera or its driver gives them, and the camera model."""

from __future__ import annotations

from dataclasses import dataclass
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
    """

    frame: str
    width_px: int
    height_px: int
    matrix: NDArray[np.float64]
    distortion: NDArray[np.float64]
    model: Literal["plumb_bob", "rational_polynomial", "equidistant"] = "plumb_bob"
