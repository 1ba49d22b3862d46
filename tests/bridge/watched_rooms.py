"""Two cameras of tests whose views overlap, as a rig places them and as a program says their boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from semap_bridge.messages.told import CameraBox
from semap_ingest.fusion.camera_model import project
from semap_ingest.sensing.image import Camera

SECOND_US = 1_000_000
START_US = 1_700_000_000 * SECOND_US
BODY_M = np.array([[x, y, z] for x in (-0.22, 0.22) for y in (-0.22, 0.22) for z in (0.0, 1.7)])
FLOOR_M = [(3.0, -1.5), (3.0, 1.5), (7.0, 1.5), (7.0, -1.5)]


@dataclass(frozen=True)
class Eye:
    """A camera at a height of 2.2 m that looks along a yaw, 15 degrees down."""

    name: str
    x_m: float
    yaw_rad: float

    def pixels(self, points_m: np.ndarray) -> np.ndarray:
        turn = Rotation.from_euler("ZY", [self.yaw_rad, np.deg2rad(15)]) * Rotation.from_quat(
            [-0.5, 0.5, -0.5, 0.5]
        )
        matrix = np.array([[320.0, 0, 320], [0, 320, 240], [0, 0, 1]])
        in_camera = (points_m - [self.x_m, 0.0, 2.2]) @ turn.as_matrix()
        return project(in_camera, Camera(self.name, 640, 480, matrix, np.zeros(5)))

    def entry(self) -> str:
        pixels = self.pixels(np.array([[x, y, 0.0] for x, y in FLOOR_M])).tolist()
        return (
            f"  {self.name}:\n    kind: camera\n    topic: {self.name}\n    homography: {{width_px: 640,"
            f" height_px: 480, pixels: {pixels}, floor_m: {[list(each) for each in FLOOR_M]}}}\n"
        )

    def sees(self, place: tuple[float, float], time_s: float, known_as: str = "a") -> CameraBox:
        pixels = self.pixels(BODY_M + np.array([*place, 0.0]))
        low, high = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
        stamp_us = START_US + round(time_s * SECOND_US)
        return CameraBox(self.name, known_as, stamp_us, (*low, *high), 0.8, "person")


WEST, EAST = Eye("west", 0.0, 0.0), Eye("east", 10.0, np.pi)
