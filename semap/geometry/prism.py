"""Prisms: a footprint carried from one height to another."""

from __future__ import annotations

import math

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.geometry.polygon import orient

from semap.errors import InvalidInput
from semap.model.building import Mesh

SAME_M = 1e-6


def extrude(footprint: Polygon | MultiPolygon, z_min_m: float, z_max_m: float) -> Mesh:
    """The prism over a footprint, normals outwards; its holes become shafts, its parts separate prisms.

    footprint  valid, not empty [m, map frame]
    raises     InvalidInput if the footprint is empty or invalid, or if z_max_m is not above z_min_m
    """
    require_prism(footprint, z_min_m, z_max_m)
    prisms = [_extrude_part(part, z_min_m, z_max_m) for part in shapely.get_parts(footprint)]
    starts = np.cumsum([0, *(len(prism.vertices_m) for prism in prisms[:-1])])
    return Mesh(
        np.concatenate([prism.vertices_m for prism in prisms]),
        np.concatenate([prism.faces + start for prism, start in zip(prisms, starts, strict=True)]),
    )


def require_prism(footprint: Polygon | MultiPolygon, z_min_m: float, z_max_m: float) -> None:
    """raises  InvalidInput if `extrude` does"""
    if footprint.is_empty or not footprint.is_valid:
        raise InvalidInput("a footprint that is empty or crosses itself", "Give a valid polygon.")
    if not (math.isfinite(z_min_m) and math.isfinite(z_max_m) and z_max_m > z_min_m):
        raise InvalidInput(
            f"a prism from {z_min_m} m to {z_max_m} m has no height", "Give a height greater than zero."
        )


def is_prism(body: Mesh, footprint: Polygon | MultiPolygon, z_min_m: float, z_max_m: float) -> bool:
    """Whether a mesh has the corners of the prism over a footprint, and no others, within a micrometre."""
    corners = shapely.get_coordinates(footprint)
    expected = np.concatenate([np.c_[corners, np.full(len(corners), z)] for z in (z_min_m, z_max_m)])
    there = _all_near(expected, body.vertices_m)
    return there and _all_near(body.vertices_m, expected)


def _all_near(points_m: NDArray[np.float64], others_m: NDArray[np.float64]) -> bool:
    """Whether each point has one of the others beside it."""
    if not len(points_m) or not len(others_m):
        return False
    from scipy.spatial import cKDTree  # noqa: PLC0415  slow to import

    distances_m, _ = cKDTree(others_m).query(points_m, distance_upper_bound=SAME_M)
    return bool(np.isfinite(distances_m).all())


def _extrude_part(part: Polygon, z_min_m: float, z_max_m: float) -> Mesh:
    outline = orient(part)
    closed = [shapely.get_coordinates(ring) for ring in (outline.exterior, *outline.interiors)]
    corners = np.concatenate([ring[:-1] for ring in closed])
    ends = np.cumsum([len(ring) - 1 for ring in closed])
    top = _counter_clockwise(
        corners, mapbox_earcut.triangulate_float64(corners, ends.astype(np.uint32)).reshape(-1, 3)
    )
    count = len(corners)
    here = np.arange(count)
    following = here + 1
    following[ends - 1] = [0, *ends[:-1]]
    walls = np.concatenate(
        [
            np.column_stack([here, following, following + count]),
            np.column_stack([here, following + count, here + count]),
        ]
    )
    vertices_m = np.empty((2 * count, 3))
    vertices_m[:count, :2] = vertices_m[count:, :2] = corners
    vertices_m[:count, 2], vertices_m[count:, 2] = z_min_m, z_max_m
    return Mesh(vertices_m, np.concatenate([top[:, ::-1], top + count, walls]))


def _counter_clockwise(corners: NDArray[np.float64], faces: NDArray[np.uint32]) -> NDArray[np.int64]:
    """The same triangles, each turned so that its signed area is not negative."""
    turned = faces.astype(np.int64)
    a, b, c = (corners[turned[:, i]] for i in range(3))
    clockwise = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    turned[clockwise] = turned[clockwise, ::-1]
    return turned
