"""Made-up persons, and what an ideal camera and laser with known noise see of them.

A person is points on a body (crown, shoulders, hands, hips, feet with toes); its box is what OpenCV projects of them.
Nothing of the package is used but the values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from semap_ingest.fusion.persons import SensorGeometry
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.image import Camera

CAMERA = Camera(
    "camera_optical",
    640,
    480,
    np.array([[320.0, 0, 320], [0, 320, 240], [0, 0, 1]]),
    np.array([-0.02, 0.005, 0, 0, 0]),
)
CAMERA_Z_M, LASER_Z_M = 1.2, 0.25
LEG_STD_M = 0.02


def pose(x: float, y: float, z: float, yaw: float, optical: bool = False) -> np.ndarray:
    transform = np.eye(4)
    c, s = np.cos(yaw), np.sin(yaw)
    transform[:3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    if optical:
        transform[:3, :3] = transform[:3, :3] @ np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    transform[:3, 3] = x, y, z
    return transform


def robot(x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> SensorGeometry:
    return SensorGeometry(CAMERA, pose(x, y, CAMERA_Z_M, yaw, optical=True), pose(x, y, LASER_Z_M, yaw))


@dataclass(frozen=True)
class Person:
    x: float
    y: float
    heading: float = 0.0
    stride: float = 0.0
    """From -1 to 1: how far the left leg is ahead of the right, as a part of a long step (0.7 m)."""
    height: float = 1.7

    @property
    def place(self) -> np.ndarray:
        return np.array([self.x, self.y])

    def _at(self, ahead: float, left: float) -> np.ndarray:
        c, s = np.cos(self.heading), np.sin(self.heading)
        return self.place + np.array([c * ahead - s * left, s * ahead + c * left])

    @property
    def legs(self) -> np.ndarray:
        return np.array([self._at(0.35 * self.stride, 0.1), self._at(-0.35 * self.stride, -0.1)])

    def points(self) -> np.ndarray:
        tall = self.height
        points = [
            [*self.place, tall],
            *([*self._at(a, b), tall - 0.1] for a, b in ((0.1, 0), (-0.1, 0), (0, 0.08), (0, -0.08))),
        ]
        for side in (1, -1):
            points += [[*self._at(a, side * 0.23), 0.82 * tall] for a in (-0.1, 0.1)]
            points += [[*self._at(-side * 0.2 * self.stride, side * 0.27), 0.45 * tall]]
            points += [[*self._at(a, side * 0.18), 0.52 * tall] for a in (-0.1, 0.12)]
            ankle = 0.35 * self.stride * side
            points += [
                [*self._at(ankle + a, side * 0.1 + b), 0.0] for a in (-0.07, 0.17) for b in (-0.04, 0.04)
            ]
        return np.array(points)


def box_of(person: Person, geometry: SensorGeometry) -> np.ndarray:
    """(4,) without noise, not cut off."""
    assert geometry.camera is not None
    assert geometry.map_T_camera is not None
    in_camera = (person.points() - geometry.map_T_camera[:3, 3]) @ geometry.map_T_camera[:3, :3]
    assert (in_camera[:, 2] > 0.05).all()
    pixels = cv2.projectPoints(
        in_camera, np.zeros(3), np.zeros(3), geometry.camera.matrix, geometry.camera.distortion
    )[0][:, 0]
    return np.array([*pixels.min(axis=0), *pixels.max(axis=0)])


def boxes_of(
    persons: Sequence[Person],
    geometry: SensorGeometry,
    generator: np.random.Generator | None = None,
    score: float = 0.9,
) -> Boxes:
    corners = np.array([box_of(person, geometry) for person in persons]).reshape(-1, 4)
    if generator is not None:
        size = (corners[:, 2:] - corners[:, :2])[:, [0, 1, 0, 1]]
        corners = corners + generator.normal(size=corners.shape) * (1.0 + 0.02 * size)
    corners = np.clip(corners, 0, [639, 479, 639, 479])
    count = len(corners)
    return Boxes(
        0, "camera_optical", corners, np.full(count, score), ("person",) * count, np.arange(count) + 7
    )


@dataclass
class Scan:
    """Clusters that are put together one by one, given in the map."""

    geometry: SensorGeometry
    centres: list[np.ndarray] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)

    def add(self, places: np.ndarray, score: float) -> Scan:
        for place in np.atleast_2d(places):
            self.centres.append(np.asarray(place, dtype=float))
            self.scores.append(score)
        return self

    def clusters(self, generator: np.random.Generator | None = None) -> LegClusters:
        count = len(self.centres)
        centres = np.array(self.centres).reshape(-1, 2)
        if generator is not None:
            centres = centres + generator.normal(0, LEG_STD_M, centres.shape)
        assert self.geometry.map_T_laser is not None
        in_laser = (centres - self.geometry.map_T_laser[:2, 3]) @ self.geometry.map_T_laser[:2, :2]
        return LegClusters(
            0,
            "laser",
            in_laser,
            np.tile(LEG_STD_M**2 * np.eye(2), (count, 1, 1)),
            np.array(self.scores, dtype=float),
            np.full(count, 0.12),
            np.full(count, 8),
        )
