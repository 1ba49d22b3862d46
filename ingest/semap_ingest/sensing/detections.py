"""Persons seen at one moment, by one sensor or by two that were joined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

CAMERA = 1
LASER = 2
BOTH = CAMERA | LASER

DETECTED = 0.9
"""Of persons in full view, where a sensor does not say otherwise."""
HINT_BITS = 32


class Sight(Protocol):
    """Where a sensor can see."""

    def reaches(self, position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,), whether who is at (n, 2) [m, map] is in its field of view, were nothing in between."""
        ...


@dataclass(frozen=True)
class Everywhere:
    """Of a finder of persons that does not say where it looks."""

    def reaches(self, position_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.ones(len(position_m), np.bool_)


@dataclass(frozen=True, eq=False)
class Detections:
    """Persons in one frame at one moment, each measured as a Gaussian on the map.

    position_m     (n, 2) [m, frame]: the middle of the body on the floor
    covariance_m2  (n, 2, 2)
    score          (n,) probability that it is a person
    seen_by        (n,) uint8: CAMERA, LASER or BOTH
    extent_m       (n, 2) length and width of the body's footprint, length along the way it walks; NaN:
                   unknown
    hint           (n,) int64, who it is to the sensor itself, such as the image track of its box (`hint_of`);
                   -1: it does not say
    sight          what was looked at
    detected       probability that a person in sight is detected
    sensor         the number of the sensor, from 0; of two that were joined, one of them
    tells_all      false: whom it does not name may be in sight nevertheless
    """

    stamp_us: int
    frame: str
    position_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    score: NDArray[np.float64]
    seen_by: NDArray[np.uint8]
    extent_m: NDArray[np.float64]
    hint: NDArray[np.int64]
    sight: Sight = Everywhere()
    detected: float = DETECTED
    sensor: int = 0
    tells_all: bool = True

    def __len__(self) -> int:
        return len(self.position_m)


def no_look(stamp_us: int, frame: str) -> Detections:
    """Nobody has looked anywhere: time goes on."""
    return Detections(
        stamp_us,
        frame,
        np.zeros((0, 2)),
        np.zeros((0, 2, 2)),
        np.zeros(0),
        np.zeros(0, np.uint8),
        np.zeros((0, 2)),
        np.zeros(0, np.int64),
        tells_all=False,
    )


def hint_of(sensor: int, track: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) hints of a sensor's own tracks, different from those of any other; -1 stays -1."""
    return np.where(track >= 0, (sensor << HINT_BITS) + track, -1)


def sensor_of(hint: NDArray[np.int64]) -> NDArray[np.int64]:
    """(n,) whose hints these are; 0 for none."""
    return np.maximum(hint, 0) >> HINT_BITS
