"""A simulated person: looks, the way through the recording, and the outline of the body on the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from semap_ingest.simulation.motion import Motion

NAMES = (
    "ann", "bob", "cem", "dora", "eve", "finn", "gita", "hugo", "iris", "jan",
    "kim", "lars", "mona", "nils", "olga", "paul", "quinn", "rosa", "sven", "tara",
)  # fmt: skip
HAIR = ((40, 30, 24), (90, 62, 36), (170, 130, 70), (120, 118, 116), (60, 40, 30))
SKIN = ((236, 198, 170), (214, 168, 134), (168, 118, 84), (110, 76, 54), (244, 212, 190))
TOP = (
    (176, 44, 44),
    (40, 74, 140),
    (232, 232, 228),
    (52, 110, 66),
    (34, 34, 38),
    (214, 160, 50),
    (120, 84, 140),
)
TROUSERS = ((32, 36, 52), (60, 60, 64), (96, 84, 66), (44, 62, 92), (20, 20, 22))
OUTLINE_POINTS = 32
OUTLINE_SPARE_M = 0.01
"""By which the polygon around an ellipse is wider, and a little more."""


@dataclass(frozen=True, eq=False)
class Person:
    """motion is one sample every hundredth of a second, the first at time 0."""

    name: str
    motion: Motion
    cruise_mps: float
    height_m: float
    width_m: float
    depth_m: float
    shin_radius_m: float
    clothes: NDArray[np.uint8]


def drawn_person(name: str, motion: Motion, random: np.random.Generator) -> Person:
    """Somebody of ordinary size and pace, in clothes of some colours."""
    colours = [palette[random.integers(len(palette))] for palette in (HAIR, SKIN, TOP, TROUSERS)]
    return Person(
        name=name,
        motion=motion,
        cruise_mps=float(random.uniform(0.9, 1.35)),
        height_m=float(np.clip(random.normal(1.72, 0.09), 1.5, 1.95)),
        width_m=float(random.uniform(0.45, 0.55)),
        depth_m=float(random.uniform(0.25, 0.35)),
        shin_radius_m=float(random.uniform(0.05, 0.07)),
        clothes=np.array(colours, dtype=np.uint8),
    )


def body_outlines(
    position_m: NDArray[np.float64], heading_rad: NDArray[np.float64], width_m: float, depth_m: float
) -> NDArray[np.object_]:
    """(n,) polygons around the ellipse that a body covers on the floor, from chest to back and side to side.

    position_m  (n, 2) [m, map]
    """
    # A polygon around the ellipse and not in it, so that what contains it contains the ellipse.
    angle = np.arange(OUTLINE_POINTS) * 2 * np.pi / OUTLINE_POINTS
    wider = 1 / np.cos(np.pi / OUTLINE_POINTS)
    along, across = wider * depth_m / 2 * np.cos(angle), wider * width_m / 2 * np.sin(angle)
    cos, sin = np.cos(heading_rad)[:, None], np.sin(heading_rad)[:, None]
    x_m = position_m[:, :1] + cos * along - sin * across
    y_m = position_m[:, 1:] + sin * along + cos * across
    outlines: NDArray[np.object_] = shapely.polygons(np.stack([x_m, y_m], axis=-1))
    return outlines


def is_all_inside(
    footprint: Polygon,
    position_m: NDArray[np.float64],
    heading_rad: NDArray[np.float64],
    width_m: float,
    depth_m: float,
) -> NDArray[np.bool_]:
    """(n,), whether all of the body is inside a room's footprint."""
    core = footprint.buffer(-width_m / 2 - OUTLINE_SPARE_M)
    shapely.prepare((footprint, core))
    inside: NDArray[np.bool_] = shapely.contains_xy(footprint, position_m[:, 0], position_m[:, 1])
    where = np.flatnonzero(inside)
    where = where[~shapely.contains_xy(core, position_m[where, 0], position_m[where, 1])]
    if len(where):
        outlines = body_outlines(position_m[where], heading_rad[where], width_m, depth_m)
        inside[where] = shapely.covers(footprint, outlines)
    return inside
