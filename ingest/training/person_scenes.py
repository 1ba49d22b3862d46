"""Made-up scenes with persons, rendered by the simulator's camera: what its person detector learns from.

A place is a room and a camera in it, from one seed: the simulator's office with the camera where the robot
stands or anywhere in the hallway, or rooms put together at random. Several images are taken at each place,
with other persons and other angles of the doors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely
from numpy.typing import NDArray
from semap_ingest.simulation.camera_view import CameraView, View
from semap_ingest.simulation.floor import BASE_FROM_CAMERA_M, CAMERA, ROBOT, office_floor
from semap_ingest.simulation.moment import Body, Moment, Surfaces
from semap_ingest.simulation.schedule import moments
from semap_ingest.simulation.settings import OfficeSettings

Floats = NDArray[np.float64]

TRAINING_SEEDS = range(900)
HELD_OUT_SEEDS = range(10_000, 10_080)
HELD_OUT_OFFICE_SEEDS = range(501, 505)
IMAGES_PER_PLACE = 6
WIDTH_PX, HEIGHT_PX = 320, 240
"""Of the network's input."""

CAMERAS = (
    CAMERA,
    replace(CAMERA, matrix=CAMERA.matrix * [[1.2, 1, 1], [1, 1.2, 1], [1, 1, 1]], distortion=np.zeros(5)),
    replace(CAMERA, distortion=np.array([-0.12, 0.02, 0.0, 0.0, 0.0])),
)


@dataclass(frozen=True, eq=False)
class Samples:
    """pixels  (n, HEIGHT_PX, WIDTH_PX, 3) uint8, red first
    image   (m,) int64, the image that each person is in
    box_px  (m, 4) x_min, y_min, x_max, y_max, of the whole person within the image [px of these images]
    visible (m,) share that is seen
    """

    pixels: NDArray[np.uint8]
    image: NDArray[np.int64]
    box_px: Floats
    visible: Floats


def samples(seeds: range) -> Samples:
    """Images of one place for each seed, with the truth."""
    pixels, images, boxes, visible = [], [], [], []
    for seed in seeds:
        for view in views(seed):
            images += [len(pixels)] * len(view.names)
            boxes.append(view.corners_px / 2)
            visible.append(view.visible)
            pixels.append(cv2.resize(view.pixels, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_LINEAR))
    return Samples(
        np.array(pixels), np.array(images, np.int64), np.concatenate(boxes), np.concatenate(visible)
    )


def views(seed: int) -> list[View]:
    """IMAGES_PER_PLACE images from one place, as they come out of a JPEG file."""
    generator = np.random.default_rng(seed)
    scene = (_office if generator.random() < 0.7 else _random_rooms)(generator)
    pose, leaves, fixed = scene.pose, scene.leaves, _tinted(scene.fixed, generator)
    camera = CAMERAS[0] if generator.random() < 0.6 else CAMERAS[int(generator.integers(len(CAMERAS)))]
    place = CameraView(camera, pose, fixed, generator)
    taken = []
    for k in range(IMAGES_PER_PLACE):
        standing = leaves(generator)
        obstacles = shapely.multilinestrings(np.concatenate([fixed.segments_m, standing.segments_m]))
        bodies = _bodies(pose, obstacles, scene.doors_m, generator)
        view = place.render(Moment(float(k), ROBOT, {}, bodies), standing, generator)
        taken.append(replace(view, pixels=_developed(view.pixels, generator)))
    return taken


def office_views(seed: int, every_s: float) -> Iterator[View]:
    """Images of the office recording of that seed, as they are in it."""
    course = moments(OfficeSettings(seed=seed))
    generator = np.random.default_rng(seed)
    ahead = BASE_FROM_CAMERA_M[0] * np.array([np.cos(ROBOT[2]), np.sin(ROBOT[2])])
    pose = _level_pose(np.array(ROBOT[:2]) + ahead, ROBOT[2], BASE_FROM_CAMERA_M[2])
    place = CameraView(CAMERA, pose, course.floor.fixed, generator)
    for time_s in np.arange(0.0, course.duration_s, every_s):
        moment = course.at(float(time_s))
        view = place.render(moment, course.floor.leaves(moment.door_rad), generator)
        yield replace(view, pixels=_through_jpeg(view.pixels, 85))


def _developed(pixels: NDArray[np.uint8], generator: np.random.Generator) -> NDArray[np.uint8]:
    """Through the exposure of another camera and JPEG."""
    tint = generator.uniform(0.8, 1.15) * generator.uniform(0.93, 1.07, 3)
    exposed = np.clip(pixels * tint + generator.uniform(-15, 15), 0, 255).astype(np.uint8)
    return _through_jpeg(exposed, int(generator.integers(70, 96)))


def _through_jpeg(pixels: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    _, data = cv2.imencode(".jpg", pixels[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])


@dataclass(frozen=True, eq=False)
class _Scene:
    """pose     map_T_camera
    doors_m  (n, 2), near which some persons stand, so that posts and leaves hide parts of them
    """

    fixed: Surfaces
    leaves: Callable[[np.random.Generator], Surfaces]
    pose: Floats
    doors_m: Floats


def _office(generator: np.random.Generator) -> _Scene:
    floor = office_floor()
    if generator.random() < 0.6:
        ahead = BASE_FROM_CAMERA_M[0] * np.array([np.cos(ROBOT[2]), np.sin(ROBOT[2])])
        place, yaw = (
            np.array(ROBOT[:2]) + ahead + generator.normal(0, 0.3, 2),
            ROBOT[2] + generator.normal(0, 0.2),
        )
    else:
        place, yaw = (
            _place_in(shapely.buffer(floor.hallway, -0.4), generator),
            generator.uniform(-np.pi, np.pi),
        )

    def leaves(generator: np.random.Generator) -> Surfaces:
        angles = {
            door.name: generator.choice([0.0, door.max_rad, generator.uniform(0, door.max_rad)])
            for door in floor.leaf_doors
        }
        return floor.leaves(angles)

    doors_m = np.array([door.position_m for door in floor.doors.values()])
    return _Scene(floor.fixed, leaves, _pose(place, yaw, generator), doors_m)


def _place_in(area: shapely.Polygon, generator: np.random.Generator) -> Floats:
    low, high = np.array(area.bounds).reshape(2, 2)
    while True:
        place = generator.uniform(low, high)
        if shapely.contains_xy(area, *place):
            return place


def _random_rooms(generator: np.random.Generator) -> _Scene:
    length, width = generator.uniform(5, 14), generator.uniform(4, 10)
    segments, heights = [], []
    corners = np.array([[0, 0], [length, 0], [length, width], [0, width]])
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        segments.append([start, end])
        heights.append([0.0, 2.6])
    for _ in range(int(generator.integers(0, 6))):
        start = generator.uniform([2, 0], [length, width])
        along = np.eye(2)[int(generator.integers(2))]
        segments.append([start, start + along * generator.uniform(0.3, 3)])
        heights.append([0.0, 2.6])
    for _ in range(int(generator.integers(0, 8))):
        middle = generator.uniform([1, 0], [length, width])
        low = 0.0 if generator.random() < 0.7 else generator.uniform(0.4, 1.2)
        high = low + generator.choice([generator.uniform(0.2, 0.9), generator.uniform(0.9, 1.9)])
        half = generator.uniform(0.03, 0.5, 2) / 2
        ring = middle + half * [[-1, -1], [1, -1], [1, 1], [-1, 1]] @ _turn(generator.uniform(0, np.pi))
        segments += list(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
        heights += [[low, high]] * 4
    colour = generator.integers(0, 255, (len(segments), 3))
    colour[:4] = generator.integers(120, 255, 3)

    def leaves(generator: np.random.Generator) -> Surfaces:
        count = int(generator.integers(0, 4))
        hinge = generator.uniform([1, 0], [length, width], (count, 2))
        angle = generator.uniform(0, 2 * np.pi, count)
        tip = hinge + 0.9 * np.column_stack([np.cos(angle), np.sin(angle)])
        heights_m = np.tile([0.0, 2.05], (count, 1))
        return Surfaces(
            np.stack([hinge, tip], axis=1), heights_m, generator.integers(0, 255, (count, 3)).astype(np.uint8)
        )

    place = generator.uniform([0.3, 0.3], [2.0, width - 0.3])
    pose = _pose(place, generator.normal(0, 0.5), generator)
    fixed = Surfaces(np.array(segments), np.array(heights), colour.astype(np.uint8))
    return _Scene(fixed, leaves, pose, fixed.segments_m[4:, 0])


def _turn(angle: float) -> Floats:
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def _pose(place_m: Floats, yaw: float, generator: np.random.Generator) -> Floats:
    """map_T_camera, level but for what a mounting is off."""
    height = 1.2 + (generator.uniform(-0.4, 0.5) if generator.random() < 0.5 else generator.normal(0, 0.03))
    pitch, roll = generator.normal(0, 0.02), generator.normal(0, 0.01)
    tilt = np.array([[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]])
    lean = np.array([[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]])
    pose = _level_pose(place_m, yaw, float(height))
    pose[:3, :3] = pose[:3, :3] @ tilt @ lean
    return pose


def _level_pose(place_m: Floats, yaw: float, height_m: float) -> Floats:
    cos, sin = np.cos(yaw), np.sin(yaw)
    pose = np.eye(4)
    pose[:3, :3] = [[sin, 0.0, cos], [-cos, 0.0, sin], [0.0, -1.0, 0.0]]
    pose[:3, 3] = *place_m, height_m
    return pose


def _tinted(surfaces: Surfaces, generator: np.random.Generator) -> Surfaces:
    tint = (
        generator.uniform(0.7, 1.1)
        * generator.uniform(0.9, 1.1, 3)
        * generator.uniform(0.95, 1.05, (len(surfaces.colour), 1))
    )
    return replace(surfaces, colour=np.clip(surfaces.colour * tint, 0, 255).astype(np.uint8))


def _bodies(
    pose: Floats, obstacles: shapely.MultiLineString, doors_m: Floats, generator: np.random.Generator
) -> tuple[Body, ...]:
    if generator.random() < 0.15:
        return ()
    yaw = np.arctan2(pose[1, 2], pose[0, 2])
    stands: list[Floats] = []
    for _ in range(int(generator.integers(4, 40))):
        if len(doors_m) and generator.random() < 0.4:
            place = generator.choice(doors_m) + generator.normal(0, 0.7, 2)
        else:
            distance, bearing = generator.uniform(0.7, 10.0), yaw + generator.uniform(-0.85, 0.85)
            place = pose[:2, 3] + distance * np.array([np.cos(bearing), np.sin(bearing)])
        apart = min((float(np.linalg.norm(place - other)) for other in stands), default=np.inf)
        # a wall in between makes a person that nobody can see, of which there would be too many
        is_hidden = shapely.LineString([pose[:2, 3], place]).crosses(obstacles) and generator.random() < 0.5
        if apart > 0.45 and not is_hidden and shapely.Point(place).distance(obstacles) > 0.25:
            stands.append(place)
    return tuple(
        _body(str(k), place, generator) for k, place in enumerate(stands[: int(generator.integers(1, 9))])
    )


def _body(name: str, place: Floats, generator: np.random.Generator) -> Body:
    heading, phase = generator.uniform(-np.pi, np.pi), generator.uniform(0, 2 * np.pi)
    swing = float(generator.choice([0.0, generator.uniform(0.3, 1.0)], p=[0.35, 0.65]))
    forward, left = (
        np.array([np.cos(heading), np.sin(heading)]),
        np.array([-np.sin(heading), np.cos(heading)]),
    )
    reach = 0.36 * swing * np.cos(phase)
    apart = generator.uniform(0.07, 0.13)
    shins = np.array([place + reach * forward + apart * left, place - reach * forward - apart * left])
    hair = generator.choice([[30, 25, 20], [70, 45, 25], [120, 85, 50], [200, 170, 110], [150, 150, 150]])
    skin = np.array([225, 180, 150]) * generator.uniform(0.35, 1.08)
    cloth = generator.uniform(10, 245, (2, 3)) * generator.uniform(0.3, 1, (2, 1))
    grey = cloth.mean(axis=1, keepdims=True)
    cloth = grey + (cloth - grey) * generator.uniform(0, 1.2)
    clothes = np.clip(np.concatenate([[hair, skin], cloth]), 0, 255).astype(np.uint8)
    girth_m, height_m = generator.uniform(0.05, 0.07), generator.uniform(1.5, 1.98)
    width_m, depth_m = generator.uniform(0.42, 0.58), generator.uniform(0.24, 0.36)
    return Body(name, place, heading, shins, girth_m, phase, swing, height_m, width_m, depth_m, clothes)
