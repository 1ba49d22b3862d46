"""The error ellipse of a position in the plane, and its covariance.

An ellipse is its standard deviation along the longer axis, that along the shorter one, and the direction of
the longer one. Where the last two are NaN the error is alike in all directions. The same is there in SQL
(sql/107).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
LEAST_M2 = 1e-30
ROUNDED = 1e-6
"""So much of the square of its trace may the determinant of a covariance be below 0, for what was rounded."""


class Ellipses(NamedTuple):
    """std_m, std_across_m [m], std_yaw_rad (from x towards y, in (-pi/2, pi/2]): each (n,)."""

    std_m: Floats
    std_across_m: Floats
    std_yaw_rad: Floats


def is_covariance(var_x_m2: ArrayLike, cov_xy_m2: ArrayLike, var_y_m2: ArrayLike) -> NDArray[np.bool_]:
    """Whether each of these is finite and positive semi-definite, but for what was rounded."""
    xx, xy, yy = (np.asarray(each, dtype=np.float64) for each in (var_x_m2, cov_xy_m2, var_y_m2))
    with np.errstate(invalid="ignore", over="ignore"):
        trace = xx + yy
        is_one = (xx >= 0) & (yy >= 0) & (trace < 1e30) & (np.abs(xy) <= trace)
        return is_one & (xx * yy - xy * xy >= -ROUNDED * trace * trace)


def ellipses_of(var_x_m2: ArrayLike, cov_xy_m2: ArrayLike, var_y_m2: ArrayLike) -> Ellipses:
    """The ellipses of covariances [m^2], each (n,); a circle where single precision knows no longer axis.

    NaN throughout where one of the three is NaN. Variances below 1e-30 count as none.
    """
    given = (np.asarray(each, dtype=np.float64) for each in (var_x_m2, cov_xy_m2, var_y_m2))
    xx, xy, yy = (np.where(np.abs(each) <= LEAST_M2, 0.0, each) for each in given)
    along = (xx + yy) / 2 + np.hypot((xx - yy) / 2, xy)
    det = np.maximum(xx * yy - xy * xy, 0.0)
    across = np.divide(det, along, out=along * 0.0, where=along > 0)
    std_m, std_across_m = np.sqrt(along), np.sqrt(across)
    is_round = ~(std_across_m.astype(np.float32) < std_m.astype(np.float32))
    yaw_rad = np.arctan2(2 * xy, xx - yy) / 2
    return Ellipses(std_m, np.where(is_round, np.nan, std_across_m), np.where(is_round, np.nan, yaw_rad))


def covariances_of(ellipses: Ellipses) -> Floats:
    """(n, 2, 2) [m^2]; NaN where std_m is."""
    std_m, std_across_m, yaw_rad = ellipses
    is_round = np.isnan(std_across_m)
    along, across = std_m**2, np.where(is_round, std_m, std_across_m) ** 2
    yaw_rad = np.where(is_round, 0.0, yaw_rad)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    xx, xy, yy = (
        along * cos**2 + across * sin**2,
        (along - across) * cos * sin,
        along * sin**2 + across * cos**2,
    )
    return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)


def turned(ellipses: Ellipses, turn: ArrayLike) -> Ellipses:
    """The ellipses in another frame; a circle stays one.

    turn  (2, 2) what of the rotation into that frame is in the plane
    """
    matrix = np.asarray(turn, dtype=np.float64)
    covariance = matrix @ covariances_of(ellipses) @ matrix.T
    found = ellipses_of(covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1])
    is_round = np.isnan(ellipses.std_across_m)
    return Ellipses(*(np.where(is_round, old, new) for old, new in zip(ellipses, found, strict=True)))
