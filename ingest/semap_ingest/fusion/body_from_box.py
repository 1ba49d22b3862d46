"""Where on the floor the body stands that a box shows.

Three things tell how far it is, each as an inverse distance, in which pixels are nearly linear (inverse
depth parametrisation: Civera, Davison, Montiel 2008):

    the bottom edge  is the foot that is nearest to the camera, on the floor
    the top edge     is the crown of a head 1.70 m +- 0.15 m above the floor
    the width        is 0.5 m, more or less

They are weighted by their information. An edge at the border of the image is cut off and tells nothing.
Where a nearer box covers the bottom edge, or the other two contradict it, the feet are hidden and it
tells little or nothing. The direction comes from the middle of the box, or from the edge that is not cut
off.

For cameras that look along the floor more or less, upright; not for those that look straight down.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.fusion.camera_model import unproject
from semap_ingest.fusion.sensor_geometry import View

HEIGHT_M, HEIGHT_STD_M = 1.70, 0.15
WIDTH_M, WIDTH_STD_M = 0.5, 0.17
FOOT_AHEAD_M, FOOT_AHEAD_STD_M = 0.2, 0.15
MIDDLE_STD_M = 0.07
"""Of the body's middle beside the middle of its box: arms and legs stick out."""
EDGE_STD_PX, EDGE_STD_OF_SIZE = 2.0, 0.03
HIDDEN_STD_OF_HEIGHT = 0.3
CUT_STDS, HIDDEN_STDS = 2.0, 3.0
CROWN_STDS = 2.5
"""So far from the camera's height at least has the crown to be to tell a distance."""
LOWEST_CAMERA_M = 0.05
"""Nearer to the floor than this, or below it as where a transform leaves z out, it tells nothing of feet."""
NEAREST_M, FARTHEST_M = 0.3, 40.0
NEARER_THAN_CUT, NEARER_THAN_CUT_STD = 1.25, 0.35
"""Inverse distance where only a cut edge tells it, as a part of what that edge would tell."""
HEAD_AT_LEAST = 0.8
UNKNOWN_PER_M, UNKNOWN_STD_PER_M = 0.25, 0.2


@dataclass(frozen=True, eq=False)
class Bodies:
    """Of n boxes; NaN where the camera model knows no ray for a box.

    position_m     (n, 2) [m, map]: the middle of the body on the floor
    covariance_m2  (n, 2, 2)
    range_m        (n,) from the camera along the floor
    """

    position_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    range_m: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Cuts:
    """(n,) each: whether the border of the image may cut the box off on this side."""

    left: NDArray[np.bool_]
    top: NDArray[np.bool_]
    right: NDArray[np.bool_]
    bottom: NDArray[np.bool_]


def cuts_of(corners_px: NDArray[np.float64], view: View) -> Cuts:
    width, height = view.camera.width_px, view.camera.height_px
    x_min, y_min, x_max, y_max = corners_px.T
    edge_x, edge_y = (CUT_STDS * std for std in _edge_std_px(corners_px))
    return Cuts(x_min <= edge_x, y_min <= edge_y, x_max >= width - 1 - edge_x, y_max >= height - 1 - edge_y)


def place(corners_px: NDArray[np.float64], view: View) -> Bodies:
    """corners_px (n, 4) as in `Boxes`, each with an area."""
    cuts = cuts_of(corners_px, view)
    x_min, y_min, x_max, y_max = corners_px.T
    x_middle, y_middle = (x_min + x_max) / 2, (y_min + y_max) / 2
    edge_x, edge_y = _edge_std_px(corners_px)
    xs = np.concatenate([x_middle, x_middle, x_middle, x_middle, x_min, x_max])
    ys = np.concatenate([y_max, y_max - edge_y, y_min, y_min + edge_y, y_middle, y_middle])
    rays = view.directions(unproject(np.column_stack([xs, ys]), view.camera))
    slopes = (rays[:, 2] / np.hypot(rays[:, 0], rays[:, 1])).reshape(6, -1)
    azimuths = np.arctan2(rays[:, 1], rays[:, 0]).reshape(6, -1)
    angle = _turned(azimuths[4] - azimuths[5])
    edge_rad = edge_x * np.abs(angle) / (x_max - x_min)
    near = _inverse_distance(corners_px, view, slopes, angle, edge_rad, cuts)
    azimuth, azimuth_std = _direction(azimuths[4], azimuths[5], near.per_m, edge_rad, cuts)
    range_m = 1 / near.per_m
    along_std_m, across_std_m = near.std_per_m * range_m**2, azimuth_std * range_m
    towards = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    across = np.column_stack([-towards[:, 1], towards[:, 0]])
    covariance = (
        along_std_m[:, None, None] ** 2 * towards[:, :, None] * towards[:, None, :]
        + across_std_m[:, None, None] ** 2 * across[:, :, None] * across[:, None, :]
    )
    return Bodies(view.centre_m[:2] + range_m[:, None] * towards, covariance, range_m)


def _edge_std_px(corners_px: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) of the upright edges, and of the level ones."""
    size = corners_px[:, 2:] - corners_px[:, :2]
    return EDGE_STD_PX + EDGE_STD_OF_SIZE * size[:, 0], EDGE_STD_PX + EDGE_STD_OF_SIZE * size[:, 1]


@dataclass(frozen=True, eq=False)
class _Estimate:
    """(n,) inverse distances along the floor and their standard deviations [1/m]; infinite: tells nothing."""

    per_m: NDArray[np.float64]
    std_per_m: NDArray[np.float64]

    def unless(self, is_void: NDArray[np.bool_]) -> _Estimate:
        return _Estimate(self.per_m, np.where(is_void, np.inf, self.std_per_m))


def _inverse_distance(
    corners_px: NDArray[np.float64],
    view: View,
    slopes: NDArray[np.float64],
    angle_rad: NDArray[np.float64],
    edge_rad: NDArray[np.float64],
    cuts: Cuts,
) -> _Estimate:
    """slopes  (4, n) climb of the rays through the bottom and a little above, the top and a little below"""
    foot = _of_foot(slopes[:2], view.centre_m[2] - view.floor_z_m, corners_px)
    head = _of_head(slopes[2:], view.floor_z_m + HEIGHT_M - view.centre_m[2])
    # What is cut off goes on beyond the border: the body is at least as near as that edge says.
    least = np.fmax(
        np.where(cuts.bottom, foot.per_m, 0.0), np.where(cuts.top, HEAD_AT_LEAST * head.per_m, 0.0)
    )
    head = head.unless(cuts.top)
    shoulders = _of_shoulders(angle_rad, edge_rad).unless(cuts.left | cuts.right)
    upper = _weighted(head, shoulders)
    with np.errstate(invalid="ignore"):
        hidden = upper.per_m - foot.per_m > HIDDEN_STDS * np.hypot(upper.std_per_m, foot.std_per_m)
    told = _weighted(foot.unless(cuts.bottom | hidden), head, shoulders)
    is_told = np.isfinite(told.std_per_m)
    is_nearer = np.where(is_told, told.per_m < least, least > UNKNOWN_PER_M)
    per_m = np.where(is_told, told.per_m, UNKNOWN_PER_M)
    std = np.where(is_told, told.std_per_m, UNKNOWN_STD_PER_M)
    per_m = np.where(is_nearer, NEARER_THAN_CUT * least, per_m)
    std = np.where(is_nearer, NEARER_THAN_CUT_STD * least, std)
    return _Estimate(np.clip(per_m, 1 / FARTHEST_M, 1 / NEAREST_M), std)


def _of_foot(slopes: NDArray[np.float64], above_floor_m: float, corners_px: NDArray[np.float64]) -> _Estimate:
    if above_floor_m < LOWEST_CAMERA_M:
        return _Estimate(np.zeros_like(slopes[0]), np.full_like(slopes[0], np.inf))
    foot, std = -slopes[0] / above_floor_m, np.abs((slopes[1] - slopes[0]) / above_floor_m)
    hidden_px = HIDDEN_STD_OF_HEIGHT * (corners_px[:, 3] - corners_px[:, 1])
    std = np.where(_covered(corners_px), std * hidden_px / _edge_std_px(corners_px)[1], std)
    with np.errstate(divide="ignore", invalid="ignore"):
        body = foot / (1 + foot * FOOT_AHEAD_M)
        return _Estimate(body, np.hypot(std, body**2 * FOOT_AHEAD_STD_M))


def _of_head(slopes: NDArray[np.float64], above_camera_m: float) -> _Estimate:
    if abs(above_camera_m) < CROWN_STDS * HEIGHT_STD_M:
        return _Estimate(np.zeros_like(slopes[0]), np.full_like(slopes[0], np.inf))
    head, std = slopes[0] / above_camera_m, (slopes[1] - slopes[0]) / above_camera_m
    return _Estimate(head, np.hypot(std, head * HEIGHT_STD_M / above_camera_m))


def _of_shoulders(angle_rad: NDArray[np.float64], edge_rad: NDArray[np.float64]) -> _Estimate:
    shoulders = 2 * np.tan(np.abs(angle_rad) / 2) / WIDTH_M
    return _Estimate(shoulders, np.hypot(shoulders * WIDTH_STD_M, np.sqrt(2) * edge_rad) / WIDTH_M)


def _weighted(*estimates: _Estimate) -> _Estimate:
    """By information; what is not a positive number is left out."""
    per_m = np.stack([each.per_m for each in estimates])
    std = np.stack([each.std_per_m for each in estimates])
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.where((per_m > 0) & (std > 0), 1 / std**2, 0.0)
        total = weight.sum(axis=0)
        mean = (weight * np.where(weight > 0, per_m, 0.0)).sum(axis=0) / total
        return _Estimate(np.where(total > 0, mean, 0.0), 1 / np.sqrt(total))


def _direction(
    left: NDArray[np.float64],
    right: NDArray[np.float64],
    per_m: NDArray[np.float64],
    edge_rad: NDArray[np.float64],
    cuts: Cuts,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) azimuth of the body's middle in the map and its standard deviation [rad]."""
    half_rad = WIDTH_M / 2 * per_m
    middle = right + _turned(left - right) / 2
    no_left, no_right = cuts.left | np.isnan(left), cuts.right | np.isnan(right)
    one_side = np.where(no_left, right + half_rad, left - half_rad)
    azimuth = np.where(no_left == no_right, middle, one_side)
    spread_m = np.where(
        no_left | no_right, np.where(no_left & no_right, WIDTH_M / 2, WIDTH_STD_M), MIDDLE_STD_M
    )
    return azimuth, np.hypot(spread_m * per_m, edge_rad / np.sqrt(2))


def _covered(corners_px: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,), whether a box that reaches farther down covers a third of the bottom edge."""
    x_min, y_min, x_max, y_max = corners_px.T
    common = np.minimum(x_max[:, None], x_max) - np.maximum(x_min[:, None], x_min)
    covers = (y_max > y_max[:, None]) & (y_min < y_max[:, None]) & (common > (x_max - x_min)[:, None] / 3)
    return np.asarray(covers.any(axis=1))


def _turned(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Into -pi to pi."""
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)
