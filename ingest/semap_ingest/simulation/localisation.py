"""Where the robot believes to be: the frames of a recording as REP 105 has them.

The wheels stand still, so that odom_T_base never changes. Localisation wanders a little about the truth, as a
particle filter does (a first-order Gauss-Markov process), and dates its map_T_odom ahead, as AMCL does by its
transform_tolerance, so that nobody who looks something up has to wait for its next word.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semap_ingest.simulation.floor import (
    BASE_FROM_CAMERA_M,
    BASE_FROM_LASER_M,
    BASE_FROM_VELODYNE_M,
    ROBOT,
)

ODOM_PERIOD_S = 1 / 50
LOCALISATION_PERIOD_S = 0.1
AHEAD_S = 0.15
PLACE_STD_M = 0.008
YAW_STD_RAD = math.radians(0.12)
MEMORY_S = 2.0

ODOM_FROM_BASE = (1.37, -0.62, 0.35)
"""Since the robot was switched on: x, y [m], yaw [rad]."""

OPTICAL_FROM_LINK = (-0.5, 0.5, -0.5, 0.5)
"""camera_link_T_camera_optical as a quaternion (x y z w): z forward, x right, y down."""

Pose = tuple[tuple[float, float, float], tuple[float, float, float, float]]
"""Translation [m] and quaternion (x y z w)."""

LEVEL = (0.0, 0.0, 0.0, 1.0)

STATIC: tuple[tuple[str, str, Pose], ...] = (
    ("base_link", "laser", (BASE_FROM_LASER_M, LEVEL)),
    ("base_link", "camera_link", (BASE_FROM_CAMERA_M, LEVEL)),
    ("camera_link", "camera_optical", ((0.0, 0.0, 0.0), OPTICAL_FROM_LINK)),
    ("base_link", "velodyne", (BASE_FROM_VELODYNE_M, LEVEL)),
)
"""Parent, child, and the child's pose in the parent."""


def odom_from_base() -> Pose:
    return _flat(*ODOM_FROM_BASE)


def map_from_odom(count: int, random: np.random.Generator) -> list[Pose]:
    """`count` poses, one each tenth of a second."""
    keep = math.exp(-LOCALISATION_PERIOD_S / MEMORY_S)
    std = np.array([PLACE_STD_M, PLACE_STD_M, YAW_STD_RAD])
    error = random.normal(0.0, std)
    poses = []
    for _ in range(count):
        poses.append(_corrected(error))
        error = keep * error + math.sqrt(1 - keep**2) * random.normal(0.0, std)
    return poses


def map_from_camera() -> NDArray[np.float64]:
    """(4, 4), map_T_camera_optical where the robot truly is."""
    x_m, y_m, yaw_rad = ROBOT
    ahead_m, left_m, up_m = BASE_FROM_CAMERA_M
    turn = Rotation.from_euler("z", yaw_rad)
    matrix = np.eye(4)
    matrix[:3, :3] = (turn * Rotation.from_quat(OPTICAL_FROM_LINK)).as_matrix()
    matrix[:3, 3] = turn.apply([ahead_m, left_m, up_m]) + np.array([x_m, y_m, 0.0])
    return matrix


def _corrected(error: NDArray[np.float64]) -> Pose:
    """map_T_odom that puts the base where it truly is, but for an error."""
    yaw_rad = ROBOT[2] + error[2] - ODOM_FROM_BASE[2]
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    x_m = ROBOT[0] + error[0] - cos * ODOM_FROM_BASE[0] + sin * ODOM_FROM_BASE[1]
    y_m = ROBOT[1] + error[1] - sin * ODOM_FROM_BASE[0] - cos * ODOM_FROM_BASE[1]
    return _flat(float(x_m), float(y_m), float(yaw_rad))


def _flat(x_m: float, y_m: float, yaw_rad: float) -> Pose:
    return (x_m, y_m, 0.0), (0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2))
