"""The cells into which lines cut the plane, and a point for each that speaks for all of it."""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from semap.geometry.union import united

CORRIDOR_M = 1e-6
"""Where two lines are one but for float noise, a corridor is left between them that joins what lies at its
ends. A point in it is as good as a point on the line: half as wide a place is no place to stand."""


def cells_between(lines_m: NDArray[np.float64]) -> NDArray[np.object_]:
    """The bounded cells between segments (n, 2, 2), cut where they cross."""
    lines = united(shapely.linestrings(lines_m))
    cells: NDArray[np.object_] = shapely.get_parts(shapely.polygonize(shapely.get_parts(lines)))
    return cells


def inner_points(cells: NDArray[np.object_]) -> NDArray[np.object_]:
    """A point in each cell, away from its boundary unless the whole cell is a corridor."""
    points: NDArray[np.object_] = shapely.point_on_surface(cells)
    is_close = shapely.distance(points, shapely.boundary(cells)) < CORRIDOR_M
    with np.errstate(all="ignore"):
        rooms = shapely.buffer(cells[is_close], -CORRIDOR_M, join_style="mitre")
    inner = shapely.point_on_surface(rooms)
    points[is_close] = np.where(shapely.is_empty(inner), points[is_close], inner)
    return points
