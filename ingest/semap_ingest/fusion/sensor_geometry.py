"""Where the sensors stand at the moment that is looked at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.image import Camera


@dataclass(frozen=True, eq=False)
class SensorGeometry:
    """None for what is not there or not known yet.

    map_T_camera  (4, 4), of the camera's optical frame (z forward)
    map_T_laser   (4, 4)
    floor_z_m     height of the floor in the map
    """

    camera: Camera | None
    map_T_camera: NDArray[np.float64] | None
    map_T_laser: NDArray[np.float64] | None
    floor_z_m: float = 0.0


@dataclass(frozen=True, eq=False)
class View:
    """A camera that stands somewhere: what there is of it in a SensorGeometry."""

    camera: Camera
    map_T_camera: NDArray[np.float64]
    floor_z_m: float

    @property
    def centre_m(self) -> NDArray[np.float64]:
        """(3,) [m, map]"""
        return self.map_T_camera[:3, 3]

    def directions(self, rays: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) of the optical frame, in the map."""
        return np.asarray(rays @ self.map_T_camera[:3, :3].T)

    def in_camera(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) points of the map, in the optical frame [m]."""
        return np.asarray((points_m - self.centre_m) @ self.map_T_camera[:3, :3])


def view_of(geometry: SensorGeometry) -> View | None:
    if geometry.camera is None or geometry.map_T_camera is None:
        return None
    return View(geometry.camera, np.asarray(geometry.map_T_camera, dtype=np.float64), geometry.floor_z_m)
