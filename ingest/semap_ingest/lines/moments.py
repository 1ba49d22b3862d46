"""Sums over points from which a line and its residual follow: a fit costs the same for any number of points.

A row of moments is the sum, over the points of one segment, of (1, x, y, x^2, y^2, x y, bx^2, by^2, bx by),
with the beam's direction b: the last three say how far noise along the beams is noise across the line. Rows
add up: the moments of two segments together are the sum of both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Moments = NDArray[np.float64]
"""(n, 9)"""


@dataclass(frozen=True, eq=False)
class Fits:
    """Lines of least squared distance, one for each row of moments.

    middle_m      (n, 2) centroid of the points
    direction     (n, 2) of length 1
    squares_m2    (n,) sum of the squared distances across the line
    spread_m2     (n,) sum of the squared distances along it, from the centroid
    variance_m2   (n,) that noise of the ranges gives each point across the line
    """

    count: NDArray[np.float64]
    middle_m: NDArray[np.float64]
    direction: NDArray[np.float64]
    squares_m2: NDArray[np.float64]
    spread_m2: NDArray[np.float64]
    variance_m2: NDArray[np.float64]


def moments_of(points_m: NDArray[np.float64]) -> Moments:
    """Of each point by itself, (n, 9); points as seen from the origin, (n, 2)."""
    x, y = points_m.T
    beam = points_m / np.maximum(np.hypot(x, y), 1e-9)[:, None]
    bx, by = beam.T
    return np.column_stack([np.ones(len(x)), x, y, x * x, y * y, x * y, bx * bx, by * by, bx * by])


def sums_before(moments: Moments) -> Moments:
    """(n + 1, 9) sums of all rows before each: rows i to j - 1 sum to the difference of rows j and i."""
    return np.concatenate([np.zeros((1, moments.shape[1])), np.cumsum(moments, axis=0)])


def fit(moments: Moments, range_std_m: float, flatness_m: float) -> Fits:
    """Total least squares: the line through the centroid along the scatter's larger eigenvector.

    Orthogonal regression as in Arras and Siegwart 1997 and Nguyen et al. 2007; the noise of a range counts
    with the part of it that lies across the line, as in Pfister et al. 2003.
    """
    count, x, y, xx, yy, xy, bxx, byy, bxy = moments.T
    x, y = x / count, y / count
    xx = xx - count * (x * x)
    yy = yy - count * (y * y)
    xy = xy - count * x * y
    half_sum, half_difference = (xx + yy) / 2, (xx - yy) / 2
    root = np.hypot(half_difference, xy)
    angle = 0.5 * np.arctan2(xy, half_difference)
    cosine, sine = np.cos(angle), np.sin(angle)
    # (b . n)^2 with the normal n = (-sin, cos)
    across = (bxx * (sine * sine) + byy * (cosine * cosine) - 2 * bxy * cosine * sine) / count
    variance = range_std_m**2 * np.minimum(np.maximum(across, 0), 1) + flatness_m**2
    squares = np.maximum(half_sum - root, 0)
    middle, direction = np.column_stack([x, y]), np.column_stack([cosine, sine])
    return Fits(count, middle, direction, squares, half_sum + root, variance)
