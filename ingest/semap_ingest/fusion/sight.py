"""Where sensors can see: a camera as far as its geometry tells, a laser up to what its beams met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap.geometry.pose import transform_points
from semap_ingest.frames.rigid import inverse
from semap_ingest.fusion.camera_model import project
from semap_ingest.fusion.sensor_geometry import View
from semap_ingest.sensing.detections import Sight
from semap_ingest.sensing.scan import Scan

BODY_M = (0.1, 0.9, 1.6)
"""Heights over the floor at which a body is looked for in an image."""
FARTHEST_M = 40.0
BODY_WIDTH_M, ACROSS = 0.3, 5
"""So wide are the legs of a body, and so many beams across it tell whether it is hidden."""
BEHIND_M = 0.5
"""What is nearer by less than this may be a part of the body itself."""


@dataclass(frozen=True, eq=False)
class CameraSight:
    """A part of the body would be in the image."""

    view: View

    def reaches(self, position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        view = self.view
        away_m = position_m - view.centre_m[:2]
        is_seen = np.zeros(len(position_m), np.bool_)
        for height_m in BODY_M:
            point_m = np.column_stack([position_m, np.full(len(position_m), view.floor_z_m + height_m)])
            u, v = project(view.in_camera(point_m), view.camera).T
            with np.errstate(invalid="ignore"):
                is_seen |= (
                    (u > 0) & (u < view.camera.width_px - 1) & (v > 0) & (v < view.camera.height_px - 1)
                )
        return np.asarray(is_seen & (np.hypot(away_m[:, 0], away_m[:, 1]) <= FARTHEST_M), np.bool_)


@dataclass(frozen=True, eq=False)
class LaserSight:
    """Within the angles and the range of the beams, and not wholly behind what they met."""

    map_T_laser: NDArray[np.float64]
    scan: Scan

    def reaches(self, position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        height_m = np.full(len(position_m), self.map_T_laser[2, 3])
        there_m = transform_points(inverse(self.map_T_laser), np.column_stack([position_m, height_m]))
        x, y = there_m[:, 0], there_m[:, 1]
        scan, range_m = self.scan, np.hypot(x, y)
        count, step_rad = len(scan.ranges_m), scan.angle_step_rad
        if count < 2 or not step_rad:
            return np.zeros(len(position_m), np.bool_)
        half_rad = np.arcsin(np.minimum(BODY_WIDTH_M / 2 / np.maximum(range_m, 1e-6), 1.0))
        across_rad = np.arctan2(y, x)[:, None] + half_rad[:, None] * np.linspace(-1, 1, ACROSS)
        # angles count from the first beam on, the way the laser turns
        turned_rad = ((across_rad - scan.angle_min_rad) * np.sign(step_rad)) % (2 * np.pi)
        beam = np.minimum(np.round(turned_rad / abs(step_rad)), count).astype(np.int64)
        met_m = np.append(np.where(scan.is_return, scan.ranges_m, np.inf), -np.inf)[beam]
        is_open = (met_m >= range_m[:, None] - BEHIND_M).any(axis=1)
        return np.asarray(is_open & (range_m <= scan.range_max_m), np.bool_)


@dataclass(frozen=True, eq=False)
class EitherSight:
    """Of two sensors that look as one."""

    first: Sight
    second: Sight

    def reaches(self, position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        return self.first.reaches(position_m) | self.second.reaches(position_m)
