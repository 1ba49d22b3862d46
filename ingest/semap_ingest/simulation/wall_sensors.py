"""Cameras and lasers on the walls of the office, each with its own rate, delay and errors.

A camera finds persons by itself and says their boxes (Detection2DArray), as network cameras do: it misses one
in ten, its edges are a few pixels off, and now and then there is a box of nobody. Whom a wall, a leaf or
somebody nearer hides has none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semap_ingest.sensing.image import Camera
from semap_ingest.simulation.figure import figures
from semap_ingest.simulation.floor import Floor
from semap_ingest.simulation.labels import stamp_us
from semap_ingest.simulation.localisation import LEVEL, OPTICAL_FROM_LINK, Pose
from semap_ingest.simulation.message import Record, boxes_data, camera_info_data
from semap_ingest.simulation.moment import Moment
from semap_ingest.simulation.noise import Stream, noise
from semap_ingest.simulation.ray import is_crossed, is_near
from semap_ingest.simulation.schedule import Moments
from semap_ingest.simulation.settings import OfficeSettings

FOCAL_PX, WIDTH_PX, HEIGHT_PX = 320.0, 640, 480
LASER_Z_M = 0.25
NEAREST_M = 0.3
BODY_RADIUS_M = 0.2
LEAST_PX = 8.0
LEAST_SHARE = 0.5
"""Of a body's height that must be in the image for a box."""
MISSED_SHARE, NOBODY_SHARE = 0.1, 0.02
EDGE_STD_PX, EDGE_STD_OF_SIZE = 1.0, 0.02
SCORE = (0.75, 0.1)
"""Of a box: mean and standard deviation."""
INFO_S = 1.0


@dataclass(frozen=True)
class WallCamera:
    """place: x, y, z [m, map], yaw, pitch (down is positive) [rad]; delay_s on the mean, half of it jitter"""

    number: int
    place: tuple[float, float, float, float, float]
    period_s: float
    first_s: float
    delay_s: float

    @property
    def name(self) -> str:
        return f"wall_camera_{self.number}"

    @property
    def camera(self) -> Camera:
        matrix = np.array(
            [[FOCAL_PX, 0.0, (WIDTH_PX - 1) / 2], [0.0, FOCAL_PX, (HEIGHT_PX - 1) / 2], [0.0, 0.0, 1.0]]
        )
        return Camera(self.name, WIDTH_PX, HEIGHT_PX, matrix, np.zeros(5))

    @property
    def turn(self) -> Rotation:
        """Of its optical frame in the map."""
        return Rotation.from_euler("ZY", self.place[3:]) * Rotation.from_quat(OPTICAL_FROM_LINK)

    @property
    def pose(self) -> Pose:
        qx, qy, qz, qw = self.turn.as_quat().tolist()
        return self.place[:3], (qx, qy, qz, qw)


@dataclass(frozen=True)
class WallLaser:
    """place: x, y [m, map], yaw [rad]"""

    number: int
    place: tuple[float, float, float]
    first_s: float

    @property
    def name(self) -> str:
        return f"wall_laser_{self.number}"

    @property
    def pose(self) -> Pose:
        x_m, y_m, yaw_rad = self.place
        return (x_m, y_m, LASER_Z_M), (*LEVEL[:2], math.sin(yaw_rad / 2), math.cos(yaw_rad / 2))


DOWN_RAD = math.radians(22)
CAMERAS = (
    WallCamera(1, (1.2, 5.1, 2.4, 0.0, DOWN_RAD), 0.1, 0.013, 0.08),
    WallCamera(2, (18.8, 5.1, 2.4, math.pi, DOWN_RAD), 0.1, 0.057, 0.12),
    WallCamera(3, (10.0, 10.15, 2.4, -math.pi / 2, DOWN_RAD), 0.2, 0.031, 0.3),
    WallCamera(4, (6.75, 6.4, 2.4, math.radians(35), DOWN_RAD), 0.1, 0.013, 0.05),
    WallCamera(5, (10.0, 14.1, 2.4, -math.pi / 2, DOWN_RAD), 0.1, 0.044, 0.08),
    WallCamera(6, (16.8, 6.6, 2.4, math.radians(135), DOWN_RAD), 0.1, 0.071, 0.08),
)
LASERS = (WallLaser(1, (1.1, 5.1, 0.0), 0.021), WallLaser(2, (18.9, 5.1, math.pi), 0.043))


def wall_cameras(settings: OfficeSettings) -> tuple[WallCamera, ...]:
    return CAMERAS[: settings.wall_cameras]


def wall_lasers(settings: OfficeSettings) -> tuple[WallLaser, ...]:
    return LASERS[: settings.wall_lasers]


def true_boxes(camera: WallCamera, floor: Floor, moment: Moment) -> NDArray[np.float64]:
    """(n, 4) x_min, y_min, x_max, y_max [px] of each body, clipped to the image; NaN: it does not see it."""
    people = figures(moment.bodies)
    eye_m = np.array(camera.place[:3])
    centre = (people.centre_m - eye_m) @ camera.turn.as_matrix()
    depth = np.maximum(centre[..., 2], 1e-3)
    middle = FOCAL_PX * centre[..., :2] / depth[..., None] + [(WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2]
    radius = (FOCAL_PX * people.radius_m / depth)[..., None]
    whole = np.hstack([(middle - radius).min(axis=1), (middle + radius).max(axis=1)])
    border = np.array([WIDTH_PX, HEIGHT_PX, WIDTH_PX, HEIGHT_PX]) - 1.0
    boxes = np.clip(whole, 0.0, border)
    size, all_of_it = boxes[:, 2:] - boxes[:, :2], whole[:, 2:] - whole[:, :2]
    is_seen = (centre[..., 2] > NEAREST_M).all(axis=1) & (size >= LEAST_PX).all(axis=1)
    is_seen &= (size >= LEAST_SHARE * all_of_it).all(axis=1)
    is_seen &= ~_hidden(eye_m[:2], floor, moment)
    boxes[~is_seen] = np.nan
    return np.asarray(boxes, np.float64)


def _hidden(eye_m: NDArray[np.float64], floor: Floor, moment: Moment) -> NDArray[np.bool_]:
    """(n,), whether a wall, a leaf or somebody nearer stands before the middle of each body."""
    middles_m = np.array([body.position_m for body in moment.bodies]).reshape(-1, 2)
    hidden = is_crossed(eye_m, middles_m, floor.sight_segments)
    hidden |= is_crossed(eye_m, middles_m, floor.leaves(moment.door_rad).segments_m)
    distance_m = np.linalg.norm(middles_m - eye_m, axis=1)
    for number, middle_m in enumerate(middles_m):
        behind = is_near(eye_m, middles_m, np.broadcast_to(middle_m, middles_m.shape), BODY_RADIUS_M)
        hidden |= behind & (distance_m > distance_m[number])
    return hidden


def wall_boxes(settings: OfficeSettings, course: Moments, camera: WallCamera) -> Iterator[Record]:
    """What a camera says, image by image, and once a second how it sees."""
    arrived_us, number = 0, 0
    while (time_s := camera.first_s + number * camera.period_s) < settings.duration_s:
        random = noise(settings, Stream.WALL_CAMERA, number * 10 + camera.number)
        delay_s = camera.delay_s * (1 + random.uniform(-0.5, 0.5))
        arrived_us = max(stamp_us(time_s + delay_s), arrived_us + 1)
        if number % round(INFO_S / camera.period_s) == 0:
            info = camera_info_data(stamp_us(time_s), camera.camera)
            yield Record(arrived_us, f"/{camera.name}/camera_info", info)
        boxes, scores = _detected(true_boxes(camera, course.floor, course.at(time_s)), random)
        data = boxes_data(stamp_us(time_s), camera.name, boxes, scores)
        yield Record(arrived_us, f"/{camera.name}/boxes", data)
        number += 1


def _detected(
    boxes: NDArray[np.float64], random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What a detector makes of the truth: boxes and scores."""
    is_kept = np.isfinite(boxes).all(axis=1) & (random.random(len(boxes)) >= MISSED_SHARE)
    kept = boxes[is_kept]
    std_px = EDGE_STD_PX + EDGE_STD_OF_SIZE * np.tile(kept[:, 2:] - kept[:, :2], 2)
    found = kept + random.normal(0.0, 1.0, kept.shape) * std_px
    if random.random() < NOBODY_SHARE:
        x, y = random.uniform(0, WIDTH_PX - 60), random.uniform(0, HEIGHT_PX - 160)
        found = np.vstack([found, [x, y, x + 50, y + 150]])
    mean, std = SCORE
    return found, np.clip(random.normal(mean, std, len(found)), 0.3, 0.99)
