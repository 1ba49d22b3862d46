"""The true state of the simulated world at one moment: what every simulated sensor looks at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Upright rectangles: walls, lintels over doors, leaves, furniture.

    segments_m  (n, 2, 2) [m, map]: two ends on the plan
    z_m         (n, 2) lower and upper edge
    colour      (n, 3) uint8, red first
    """

    segments_m: NDArray[np.float64]
    z_m: NDArray[np.float64]
    colour: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Body:
    """A person at one moment.

    position_m   (2,) [m, map]: the middle of the body on the floor
    heading_rad  where it faces
    shins_m      (2, 2) [m, map]: axis of the left and of the right shin at the height of a 2D laser
    shin_radius_m
    phase_rad    of the gait: 0 and pi are the moments of heel strike
    swing        0 standing to 1 full stride: how far legs and arms swing
    height_m, width_m, depth_m   of the body: shoulder to shoulder, chest to back
    clothes      (4, 3) uint8: hair, skin, top, trousers
    """

    name: str
    position_m: NDArray[np.float64]
    heading_rad: float
    shins_m: NDArray[np.float64]
    shin_radius_m: float
    phase_rad: float
    swing: float
    height_m: float
    width_m: float
    depth_m: float
    clothes: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Moment:
    """The whole world at `time_s` since the recording's beginning.

    robot        map_T_base: x, y [m], yaw [rad]
    door_rad     how far each leaf is open, by the door's name; 0 closed
    """

    time_s: float
    robot: tuple[float, float, float]
    door_rad: Mapping[str, float]
    bodies: tuple[Body, ...]
