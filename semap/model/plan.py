"""What a plan shows, in metres of the map frame, seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import shapely
from numpy.typing import NDArray


class Kind(StrEnum):
    """How a thing is drawn."""

    ROOM = "room"
    DOOR = "door"
    THING = "thing"


@dataclass(frozen=True)
class Thing:
    """Something on the map: an area, a line, or a point where nothing is known of its outline."""

    instance_id: int
    name: str
    kind: Kind
    shape: shapely.Geometry


@dataclass(frozen=True)
class Person:
    """Someone or something that moves, at a moment.

    std_across_m, std_yaw_rad  as in a track's state: of its error ellipse, None where it is a circle of std_m
    trail  where it was just before, x and y [m], the oldest first
    """

    name: str
    x_m: float
    y_m: float
    heading_rad: float | None
    std_m: float | None
    trail: Sequence[tuple[float, float]]
    std_across_m: float | None = None
    std_yaw_rad: float | None = None


@dataclass(frozen=True)
class Way:
    """Where a track was. points_m  (n, 2) float64 [m], by time"""

    name: str
    points_m: NDArray[np.float64]
