"""How a person moves, as samples a hundredth of a second apart: standing, turning, walking a way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.simulation.way import Polyline, distances_along, distances_at, headings, timed

STEP_S = 0.01
TURN_RADPS = 1.3
SHORTEST_TURN_S = 0.3
SAME_HEADING_RAD = 0.02


@dataclass(frozen=True, eq=False)
class Motion:
    """position_m (n, 2) [m, map], heading_rad (n,) unwrapped; the first sample is a step after the start"""

    position_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.heading_rad)

    @property
    def length_s(self) -> float:
        return len(self) * STEP_S

    def then(self, *others: Motion) -> Motion:
        parts = [self, *others]
        return Motion(
            np.concatenate([part.position_m for part in parts]),
            np.concatenate([part.heading_rad for part in parts]),
        )


def stand(position_m: NDArray[np.float64], heading_rad: float, length_s: float) -> Motion:
    count = round(length_s / STEP_S)
    return Motion(np.tile(position_m, (count, 1)), np.full(count, heading_rad))


def turn(position_m: NDArray[np.float64], heading_rad: float, wanted_rad: float) -> Motion:
    """Turn on the spot, the shorter way round."""
    change_rad = math.remainder(wanted_rad - heading_rad, math.tau)
    if abs(change_rad) < SAME_HEADING_RAD:
        return stand(position_m, heading_rad, 0.0)
    count = math.ceil(max(SHORTEST_TURN_S, abs(change_rad) / TURN_RADPS) / STEP_S)
    share = minimum_jerk(np.arange(1, count + 1) / count)
    return Motion(np.tile(position_m, (count, 1)), heading_rad + change_rad * share)


def walk(way_m: Polyline, heading_rad: float, speed_mps: float) -> Motion:
    """Turn towards an evenly spaced way and walk it from rest to rest; a way of no length is none."""
    along_m = distances_along(way_m)
    if along_m[-1] == 0:
        return stand(way_m[0], heading_rad, 0.0)
    facing = headings(way_m)
    turned = turn(way_m[0], heading_rad, float(facing[0]))
    last_rad = float(turned.heading_rad[-1]) if len(turned) else heading_rad
    facing = facing + round((last_rad - facing[0]) / math.tau) * math.tau
    reached_s, speeds_mps = timed(way_m, speed_mps)
    count = math.ceil(reached_s[-1] / STEP_S)
    wanted_m = distances_at(np.arange(1, count + 1) * STEP_S, reached_s, speeds_mps, along_m)
    walked = Motion(
        np.column_stack([np.interp(wanted_m, along_m, way_m[:, axis]) for axis in (0, 1)]),
        np.interp(wanted_m, along_m, facing),
    )
    return turned.then(walked)


def minimum_jerk(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far a hand, a leaf or a turning body has come at a share of its time (Flash and Hogan 1985)."""
    return share**3 * (10 - 15 * share + 6 * share**2)
