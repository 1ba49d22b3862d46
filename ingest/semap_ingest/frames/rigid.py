"""Rigid motions, one at a time and so in plain floats: unit quaternions (x y z w), homogeneous matrices."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Quaternion = tuple[float, float, float, float]
Point = tuple[float, float, float]

SO_NEAR = 1 - 1e-9
"""Cosine from which an arc is its chord: they differ by less than 1e-13 rad."""


def slerp(start: Quaternion, end: Quaternion, fraction: float) -> Quaternion:
    """The turn at `fraction` (0 to 1) of the shorter way from one to the other, at a constant rate.

    Shoemake 1985, Animating rotation with quaternion curves.
    """
    cosine = sum(a * b for a, b in zip(start, end, strict=True))
    sign = math.copysign(1.0, cosine)  # a quaternion and its negative are the same turn
    if abs(cosine) > SO_NEAR:
        of_start, of_end = 1 - fraction, sign * fraction
    else:
        angle = math.acos(abs(cosine))
        of_start = math.sin((1 - fraction) * angle) / math.sin(angle)
        of_end = sign * math.sin(fraction * angle) / math.sin(angle)
    x, y, z, w = (of_start * a + of_end * b for a, b in zip(start, end, strict=True))
    length = math.hypot(x, y, z, w)
    return x / length, y / length, z / length, w / length


def matrix(translation_m: Point, quaternion: Quaternion) -> NDArray[np.float64]:
    """(4, 4) parent_T_child of where the child's origin is and how the child is turned in its parent."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), translation_m[0]],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), translation_m[1]],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), translation_m[2]],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def inverse(parent_T_child: NDArray[np.float64]) -> NDArray[np.float64]:
    """(4, 4) child_T_parent."""
    turned_back = parent_T_child[:3, :3].T
    child_T_parent = np.eye(4)
    child_T_parent[:3, :3] = turned_back
    child_T_parent[:3, 3] = -turned_back @ parent_T_child[:3, 3]
    return child_T_parent
