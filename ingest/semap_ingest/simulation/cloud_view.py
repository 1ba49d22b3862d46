"""What a 3D laser on the robot measures: a Velodyne VLP-16, all of a turn at one moment.

Its data sheet: 16 rings from -15 to 15 degrees, 10 Hz, up to 100 m, 3 cm accuracy. Every second azimuth is
left out (0.4 degree), which halves the recording. A body is two shins below the hip and a cylinder above.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from semap_ingest.simulation.floor import BASE_FROM_VELODYNE_M, CEILING_M, ROBOT, Floor
from semap_ingest.simulation.moment import Body, Moment
from semap_ingest.simulation.ray import to_circles, to_segments

PERIOD_S = 0.1
RINGS_RAD = np.radians(np.arange(-15.0, 16.0, 2.0))
AZIMUTHS = 900
RANGE_STD_M = 0.03
HIP_SHARE = 0.5
TRUNK_SHARE = 0.4
"""Radius of the trunk as a share of the shoulders' width."""

Floats = NDArray[np.float64]


class CloudView:
    """A 3D laser that stays where it is. State: none but what never moves, cast once."""

    def __init__(self, floor: Floor) -> None:
        self._floor = floor
        x_m, y_m, yaw_rad = ROBOT
        self._place_m = np.array([x_m, y_m])
        own_rad = np.arange(AZIMUTHS) * 2 * np.pi / AZIMUTHS - np.pi
        self._own = np.column_stack([np.cos(own_rad), np.sin(own_rad)])
        turn = np.array([[math.cos(yaw_rad), math.sin(yaw_rad)], [-math.sin(yaw_rad), math.cos(yaw_rad)]])
        self._rays = self._own @ turn
        slopes = np.tan(RINGS_RAD)
        height_m = BASE_FROM_VELODYNE_M[2]
        to_floor = np.where(slopes < 0, -height_m / np.minimum(slopes, -1e-9), np.inf)
        to_ceiling = np.where(slopes > 0, (CEILING_M - height_m) / np.maximum(slopes, 1e-9), np.inf)
        empty = np.tile(np.minimum(to_floor, to_ceiling), (AZIMUTHS, 1))
        self._slopes = slopes
        self._fixed_m = self._nearer(empty, floor.fixed.segments_m, floor.fixed.z_m)

    def points(self, moment: Moment, random: np.random.Generator) -> NDArray[np.float32]:
        """(n, 3) float32 [m, velodyne]."""
        leaves = self._floor.leaves(moment.door_rad)
        plan_m = self._nearer(self._fixed_m, leaves.segments_m, leaves.z_m)
        for body in moment.bodies:
            plan_m = self._before_body(plan_m, body)
        noise_m = random.normal(0.0, RANGE_STD_M, plan_m.shape)
        plan_m = plan_m + noise_m * np.cos(RINGS_RAD)
        met = np.isfinite(plan_m)
        points_m = np.concatenate(
            [plan_m[..., None] * self._own[:, None], (plan_m * self._slopes)[..., None]], axis=-1
        )
        measured_m: NDArray[np.float32] = points_m[met].astype(np.float32)
        return measured_m

    def _nearer(self, plan_m: Floats, segments_m: Floats, z_m: Floats) -> Floats:
        """(azimuths, rings) distances on the plan, after upright rectangles."""
        nearest = plan_m.copy()
        for segment_m, (low_m, high_m) in zip(segments_m, z_m, strict=True):
            distance_m = to_segments(self._place_m, self._rays, segment_m[None])
            self._put(nearest, distance_m, low_m, high_m)
        return nearest

    def _before_body(self, plan_m: Floats, body: Body) -> Floats:
        nearest = plan_m.copy()
        hip_m = HIP_SHARE * body.height_m
        for shin_m in body.shins_m:
            self._put(
                nearest, to_circles(self._place_m, self._rays, shin_m[None], body.shin_radius_m), 0.0, hip_m
            )
        trunk_m = to_circles(self._place_m, self._rays, body.position_m[None], TRUNK_SHARE * body.width_m)
        self._put(nearest, trunk_m, hip_m, body.height_m)
        return nearest

    def _put(self, plan_m: Floats, distance_m: Floats, low_m: float, high_m: float) -> None:
        rows = np.flatnonzero(np.isfinite(distance_m))
        height_m = BASE_FROM_VELODYNE_M[2] + distance_m[rows, None] * self._slopes
        is_met = (height_m >= low_m) & (height_m <= high_m) & (distance_m[rows, None] < plan_m[rows])
        plan_m[rows] = np.where(is_met, distance_m[rows, None], plan_m[rows])
