"""Everybody as the sensors could see them, scan by scan: the truth that trackers are compared with."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from semap_ingest.simulation.floor import BASE_FROM_CAMERA_M, CAMERA, ROBOT, Floor
from semap_ingest.simulation.labels import TrackLabels
from semap_ingest.simulation.laser_view import Ranges
from semap_ingest.simulation.moment import Moment
from semap_ingest.simulation.ray import is_crossed, is_near
from semap_ingest.simulation.wall_sensors import WallCamera, true_boxes

BODY_RADIUS_M = 0.2


def track_labels(
    floor: Floor,
    people: tuple[str, ...],
    stamps_us: list[int],
    moments: list[Moment],
    ranges: list[Ranges],
    on_walls: tuple[WallCamera, ...] = (),
) -> TrackLabels:
    """Of scans with these stamps, each with the moment at its first beam and what its beams met.

    on_walls  cameras besides the robot's
    """
    count = len(people)
    beams = [np.bincount(scan.shin_of[scan.shin_of >= 0], minlength=count) for scan in ranges]
    shape = (len(moments), count)
    bodies = [moment.bodies for moment in moments]
    position_m = np.array([[body.position_m for body in each] for each in bodies]).reshape(*shape, 2)
    heading_rad = np.array([[body.heading_rad for body in each] for each in bodies]).reshape(shape)
    seen = np.array([_in_camera(floor, moment) for moment in moments]).reshape(shape)
    for camera in on_walls:
        boxes = np.array([true_boxes(camera, floor, moment) for moment in moments])
        seen = seen | np.isfinite(boxes.reshape(*shape, 4)).all(axis=2)
    return TrackLabels(
        people,
        np.array(stamps_us, dtype=np.int64),
        position_m.transpose(1, 0, 2),
        np.angle(np.exp(1j * heading_rad)).T,
        np.array(beams, dtype=np.int64).reshape(shape).T,
        seen.T,
    )


def _in_camera(floor: Floor, moment: Moment) -> NDArray[np.bool_]:
    """(n,), whether the camera sees the middle of each body."""
    x_m, y_m, yaw_rad = ROBOT
    ahead = np.array([math.cos(yaw_rad), math.sin(yaw_rad)])
    camera_m = np.array([x_m, y_m]) + BASE_FROM_CAMERA_M[0] * ahead
    middles_m = np.array([body.position_m for body in moment.bodies])
    from_camera = middles_m - camera_m
    ahead_m = from_camera @ ahead
    left_m = from_camera @ np.array([-ahead[1], ahead[0]])
    half_view = CAMERA.width_px / 2 / CAMERA.matrix[0, 0]
    seen: NDArray[np.bool_] = (ahead_m > 0) & (np.abs(left_m) < half_view * ahead_m)
    seen &= ~is_crossed(camera_m, middles_m, floor.sight_segments)
    seen &= ~is_crossed(camera_m, middles_m, floor.leaves(moment.door_rad).segments_m)
    for number, middle_m in enumerate(middles_m):
        hidden = is_near(camera_m, middles_m, np.broadcast_to(middle_m, middles_m.shape), BODY_RADIUS_M)
        hidden[number] = False
        distance_m = np.linalg.norm(from_camera, axis=1)
        seen &= ~(hidden & (distance_m > distance_m[number]))
    return seen
