"""Furniture as a laser sees it: tables and chairs are legs at its height, bins and plants are round."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon

from semap_ingest.simulation.moment import Surfaces

LEG_M = 0.04
POLE_RADIUS_M = 0.025
ROUND_EDGES = 10

WOOD = (164, 128, 88)
STEEL = (72, 74, 80)
LEAVES = (70, 120, 62)
POT = (150, 84, 60)
SIGN = (222, 190, 40)

Part = tuple[NDArray[np.float64], tuple[float, float], tuple[int, int, int]]
"""A closed outline around the thing's own middle [m], its lower and upper edge [m], its colour."""


@dataclass(frozen=True)
class Thing:
    """size_m  length along its own x, width, height"""

    name: str
    concept: str
    position_m: tuple[float, float]
    yaw_rad: float
    size_m: tuple[float, float, float]

    @cached_property
    def footprint(self) -> Polygon:
        """Where nobody can stand [m, map]."""
        length_m, width_m, _ = self.size_m
        return Polygon(self.to_map(_rectangle(0.0, 0.0, length_m, width_m)))

    def to_map(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 2) from the thing's own frame to the map's."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        placed: NDArray[np.float64] = points_m @ np.array([[cos, sin], [-sin, cos]]) + self.position_m
        return placed


def furniture_surfaces(thing: Thing) -> Surfaces:
    """Its upright faces. What has no height, such as the top of a table, only shows its rim."""
    segments, heights, colours = [], [], []
    for outline, z_m, colour in _parts(thing):
        ring = thing.to_map(outline)
        segments.append(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
        heights.append(np.tile(z_m, (len(ring), 1)))
        colours.append(np.tile(np.array(colour, dtype=np.uint8), (len(ring), 1)))
    return Surfaces(np.concatenate(segments), np.concatenate(heights), np.concatenate(colours))


def _parts(thing: Thing) -> list[Part]:
    length_m, width_m, height_m = thing.size_m
    match thing.concept:
        case "Table":
            top = _rectangle(0.0, 0.0, length_m, width_m)
            return [*_legs(length_m, width_m, height_m, WOOD), (top, (height_m - 0.04, height_m), WOOD)]
        case "Chair":
            seat_m = height_m / 2
            seat = _rectangle(0.0, 0.0, length_m, width_m)
            back = _rectangle(-length_m / 2 + 0.02, 0.0, 0.04, width_m)
            return [
                *_legs(length_m, width_m, seat_m, STEEL),
                (seat, (seat_m - 0.05, seat_m), STEEL),
                (back, (seat_m, height_m), STEEL),
            ]
        case "Plant":
            pot_m = 0.3 * height_m
            crown = _round(length_m / 2)
            return [(_round(0.4 * length_m), (0.0, pot_m), POT), (crown, (pot_m, height_m), LEAVES)]
        case "Sign":
            board = _rectangle(0.0, 0.0, length_m, width_m)
            return [
                (_round(POLE_RADIUS_M), (0.0, 0.65 * height_m), STEEL),
                (board, (0.65 * height_m, height_m), SIGN),
            ]
        case _:
            return [(_round(length_m / 2), (0.0, height_m), STEEL)]


def _legs(length_m: float, width_m: float, height_m: float, colour: tuple[int, int, int]) -> list[Part]:
    x_m, y_m = (length_m - LEG_M) / 2, (width_m - LEG_M) / 2
    corners = [(-x_m, -y_m), (x_m, -y_m), (x_m, y_m), (-x_m, y_m)]
    return [(_rectangle(x, y, LEG_M, LEG_M), (0.0, height_m), colour) for x, y in corners]


def _rectangle(x_m: float, y_m: float, length_m: float, width_m: float) -> NDArray[np.float64]:
    half = np.array([length_m, width_m]) / 2
    return np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + (x_m, y_m)


def _round(radius_m: float) -> NDArray[np.float64]:
    turn = np.arange(ROUND_EDGES) * 2 * np.pi / ROUND_EDGES
    return radius_m * np.column_stack([np.cos(turn), np.sin(turn)])
