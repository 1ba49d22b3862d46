"""How much rectangles in an image overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def jaccard_index(left_px: Floats, right_px: Floats) -> Floats:
    """Intersection over union of each of n with each of m rectangles; 0 where neither has an area.

    left_px, right_px  (n, 4), (m, 4) x_min, y_min, x_max, y_max
    returns            (n, m)
    """
    low = np.maximum(left_px[:, None, :2], right_px[None, :, :2])
    high = np.minimum(left_px[:, None, 2:], right_px[None, :, 2:])
    intersection = np.prod(np.maximum(high - low, 0.0), axis=2)
    union = _area(left_px)[:, None] + _area(right_px)[None, :] - intersection
    index: Floats = np.divide(intersection, union, out=np.zeros_like(union), where=union > 0)
    return index


def widened(corners_px: Floats, share: Floats | float) -> Floats:
    """Each rectangle wider and higher by `share` (n,) of its size on every side."""
    margin = np.asarray(share, np.float64)[..., None] * (corners_px[:, 2:] - corners_px[:, :2])
    return np.hstack([corners_px[:, :2] - margin, corners_px[:, 2:] + margin])


def centre_and_size(corners_px: Floats) -> Floats:
    """(n, 4) centre x and y, width, height"""
    low, high = corners_px[:, :2], corners_px[:, 2:]
    return np.hstack([(low + high) / 2, high - low])


def corners(centre_and_size_px: Floats) -> Floats:
    """The inverse of `centre_and_size`; a size below one pixel counts as one."""
    centre, half = centre_and_size_px[:, :2], np.maximum(centre_and_size_px[:, 2:], 1.0) / 2
    return np.hstack([centre - half, centre + half])


def _area(corners_px: Floats) -> Floats:
    width_px, height_px = np.maximum(corners_px[:, 2:] - corners_px[:, :2], 0.0).T
    return np.asarray(width_px * height_px, np.float64)
