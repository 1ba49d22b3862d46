"""What a 2D laser on the robot measures: a SICK TiM571, beam by beam.

Its data sheet: 270 degrees in steps of 0.33 degree (811 beams), 15 Hz, 0.05 to 25 m, a statistical error of
20 mm (1 sigma). A systematic error (at most 60 mm) is taken to be calibrated away. The mirror turns
counter-clockwise, and every beam sees the world at its own time: legs and leaves move on during a sweep.

A beam ends at the nearest wall, leaf, piece of furniture or shin. At an edge it may return a mixture of both
distances, and some return nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.simulation.floor import ROBOT, Floor, laser_place_m
from semap_ingest.simulation.moment import Moment
from semap_ingest.simulation.ray import to_circles, to_segments

BEAMS = 811
ANGLE_MIN_RAD = math.radians(-135.0)
ANGLE_STEP_RAD = math.radians(270.0) / (BEAMS - 1)
PERIOD_S = 1 / 15
SWEEP_S = PERIOD_S * 270 / 360
"""From the first beam to the last."""

BEAM_S = SWEEP_S / (BEAMS - 1)
RANGE_MIN_M = 0.05
RANGE_MAX_M = 25.0
RANGE_STD_M = 0.02
STEP_M = 0.001
DROPOUT_SHARE = 0.007
MIXED_SHARE = 0.2
"""Of the beams beside an edge."""

EDGE_M = 0.15

NO_RETURN = np.float32(np.inf)
"""As REP 117 says it."""


@dataclass(frozen=True, eq=False)
class Ranges:
    """true_m (811,) to what each beam meets, infinite if nothing; shin_of (811,) whose body it is, or -1"""

    true_m: NDArray[np.float64]
    shin_of: NDArray[np.int64]


class LaserView:
    """A laser that stays where it is. State: none but what never moves, cast once."""

    def __init__(self, floor: Floor, place: tuple[float, float, float] | None = None) -> None:
        """place: x, y [m, map] and yaw [rad]; None: the robot's"""
        self._floor = floor
        x_m, y_m, yaw_rad = place or (*laser_place_m(), ROBOT[2])
        self._place_m = np.array([x_m, y_m])
        angles_rad = yaw_rad + ANGLE_MIN_RAD + ANGLE_STEP_RAD * np.arange(BEAMS)
        self._beams = np.column_stack([np.cos(angles_rad), np.sin(angles_rad)])
        self._fixed_m = to_segments(self._place_m, self._beams, floor.laser_segments)

    def sweep(self, first: Moment, last: Moment) -> Ranges:
        """True ranges of a sweep between two moments, during which everything moves evenly."""
        share = np.arange(BEAMS) / (BEAMS - 1)
        ranges_m = self._fixed_m
        for door in self._floor.leaf_doors:
            begin_rad, end_rad = first.door_rad[door.name], last.door_rad[door.name]
            leaf_m = door.leaf_m(begin_rad)
            if begin_rad == end_rad:
                met_m = to_segments(self._place_m, self._beams, leaf_m[None])
            else:
                tips_m = leaf_m[1] + share[:, None] * (door.leaf_m(end_rad)[1] - leaf_m[1])
                moving_m = np.stack([np.broadcast_to(leaf_m[0], tips_m.shape), tips_m], axis=1)
                met_m = to_segments(self._place_m, self._beams, moving_m[:, None])
            ranges_m = np.minimum(ranges_m, met_m)
        shin_of = np.full(BEAMS, -1)
        for number, (begin, end) in enumerate(zip(first.bodies, last.bodies, strict=True)):
            moved_m = end.shins_m - begin.shins_m
            axes_m = begin.shins_m + share[:, None, None] * moved_m
            met_m = to_circles(self._place_m, self._beams, axes_m, begin.shin_radius_m)
            shin_of[met_m < ranges_m] = number
            ranges_m = np.minimum(ranges_m, met_m)
        return Ranges(ranges_m, shin_of)


def measured(true_m: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float32]:
    """(811,) what the sensor says: mixed at edges, noisy, in whole millimetres, some missing."""
    ranges_m = np.minimum(true_m, 2 * RANGE_MAX_M)
    beyond_m = np.roll(ranges_m, -1)
    beyond_m[-1] = ranges_m[-1]
    is_mixed = (np.abs(beyond_m - ranges_m) > EDGE_M) & (random.random(len(ranges_m)) < MIXED_SHARE)
    ranges_m = ranges_m + np.where(is_mixed, random.random(len(ranges_m)), 0.0) * (beyond_m - ranges_m)
    ranges_m = ranges_m + random.normal(0.0, RANGE_STD_M, len(ranges_m))
    ranges_m = np.round(ranges_m / STEP_M) * STEP_M
    is_lost = random.random(len(ranges_m)) < DROPOUT_SHARE
    is_lost |= (ranges_m < RANGE_MIN_M) | (ranges_m > RANGE_MAX_M)
    return np.where(is_lost, NO_RETURN, ranges_m).astype(np.float32)
