"""The smallest rectangle and the smallest box around a convex hull, and boxes as meshes.

A smallest rectangle has a side along an edge of the hull (Freeman and Shapira 1975). For boxes only those
with a face along a face of the hull are tried, as is usual, and the upright one; O'Rourke's exact minimum
(1985) is rarely smaller by more than a few per cent. Of equally small ones the most upright is taken, then
the one along the longest edge, so that a box does not turn with float noise.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from semap.geometry.projection import cross_3d
from semap.model.building import Mesh

FACES_TRIED = 400
"""The largest of the hull; a hull of at most so many faces is tried in full."""

FACES_OF_MANY = 100

VERTICES_TRIED = 3_000
"""A hull of more vertices is tried by those that are extreme for the faces tried."""

EQUAL = 1e-9

UPRIGHT = 1e-12
"""Faces whose unit normals are so near to vertical or horizontal are floors, ceilings and walls."""

BOX_FACES = np.array(
    [
        0,
        2,
        1,
        0,
        3,
        2,
        4,
        5,
        6,
        4,
        6,
        7,
        0,
        1,
        5,
        0,
        5,
        4,
        1,
        2,
        6,
        1,
        6,
        5,
        2,
        3,
        7,
        2,
        7,
        6,
        3,
        0,
        4,
        3,
        4,
        7,
    ],
    dtype=np.int64,
).reshape(12, 3)
"""Of the corners 000 100 110 010 001 101 111 011."""

BOX_CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=np.float64
)


def box_mesh(
    low_m: NDArray[np.float64], high_m: NDArray[np.float64], parent_R_box: NDArray[np.float64] | None = None
) -> Mesh:
    """The closed box between two corners (3,) [m, box frame], as twelve triangles wound outwards.

    parent_R_box  (3, 3), a rotation; the box is returned in its parent frame
    A box without thickness has zero-area triangles at its sides.
    """
    corners_m = np.where(BOX_CORNERS == 0, low_m, high_m)
    return Mesh(corners_m if parent_R_box is None else corners_m @ parent_R_box.T, BOX_FACES)


def smallest_rectangle(ring_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners (4, 2), counter-clockwise, of the smallest rectangle around a convex ring (n, 2)."""
    axis, low_m, high_m = _rectangle(ring_m)
    sideways = np.array([-axis[1], axis[0]])
    corners = BOX_CORNERS[:4, :2]
    along_m = np.where(corners[:, 0] == 0, low_m[0], high_m[0])
    across_m = np.where(corners[:, 1] == 0, low_m[1], high_m[1])
    return np.outer(along_m, axis) + np.outer(across_m, sideways)


def smallest_box(hull: Mesh) -> Mesh:
    """The smallest box around a closed convex mesh, which may be flat."""
    from scipy.spatial import QhullError  # noqa: PLC0415  slow to import

    normals = _normals(hull)
    vertices_m = hull.vertices_m
    tried_m = vertices_m
    if len(vertices_m) > VERTICES_TRIED:
        normals = normals[:FACES_OF_MANY]
        extremes = [[np.argmin(d), np.argmax(d)] for d in (vertices_m @ normal for normal in normals)]
        tried_m = vertices_m[np.unique(extremes)]
    best: tuple[float, NDArray[np.float64]] | None = None
    for normal in normals:
        rotation = _frame(normal)
        flat = tried_m @ rotation
        try:
            axis, low_m, high_m = _rectangle(_ring(flat[:, :2]))
        except QhullError:
            # Seen along this normal, the hull is a line.
            continue
        # A flat body is compared by area.
        volume = float(np.prod(high_m - low_m)) * max(float(np.ptp(flat[:, 2])), 1e-12)
        if best is None or volume < best[0] * (1 - EQUAL):
            turn = np.array([[axis[0], -axis[1], 0], [axis[1], axis[0], 0], [0, 0, 1]])
            best = volume, rotation @ turn
    parent_R_box = np.eye(3) if best is None else best[1]
    inside_m = vertices_m @ parent_R_box
    return box_mesh(inside_m.min(axis=0), inside_m.max(axis=0), parent_R_box)


def _normals(hull: Mesh) -> NDArray[np.float64]:
    """Unit normals (k, 3): the vertical, then those of the largest faces, one of each direction."""
    corners_m = hull.vertices_m[hull.faces]
    normals = cross_3d(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    largest = np.argsort(-areas, kind="stable")[: 4 * FACES_TRIED]
    largest = largest[areas[largest] > 0]
    units = np.concatenate([[[0.0, 0.0, 1.0]], normals[largest] / areas[largest, None]])
    up, aside = np.abs(units[:, 2]), np.hypot(units[:, 0], units[:, 1])
    if np.minimum(up, aside).max() < UPRIGHT < aside.max() and aside[1:].min() < UPRIGHT:
        # A prism: from each side it is a rectangle that stands upright, and those are found from above.
        return units[:1]
    kept = [0]
    for place in range(1, len(units)):
        if len(kept) > FACES_TRIED:
            break
        if np.abs(units[kept] @ units[place]).max() < 1 - 1e-12:
            kept.append(place)
    return units[kept]


def _frame(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """A rotation (3, 3) whose third column is the normal."""
    across = cross_3d(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    return np.column_stack([across, cross_3d(normal, across), normal])


def _ring(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    from scipy.spatial import ConvexHull  # noqa: PLC0415  slow to import

    ring: NDArray[np.float64] = points_m[ConvexHull(points_m).vertices]
    return ring


def _rectangle(
    ring_m: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Direction (2,) of a side of the smallest rectangle, and its extents along and across that."""
    edges = np.concatenate([ring_m[1:], ring_m[:1]]) - ring_m
    lengths = np.sqrt(np.einsum("ij,ij->i", edges, edges))
    longest_first = np.argsort(-lengths, kind="stable")
    # An edge as short as float noise has no direction.
    longest_first = longest_first[lengths[longest_first] > EQUAL * lengths.max()]
    axes = edges[longest_first] / lengths[longest_first, None]
    along = ring_m @ axes.T
    across = ring_m @ np.column_stack([-axes[:, 1], axes[:, 0]]).T
    low_m = np.stack([along.min(axis=0), across.min(axis=0)], axis=1)
    high_m = np.stack([along.max(axis=0), across.max(axis=0)], axis=1)
    areas = (high_m - low_m).prod(axis=1)
    best = int(np.argmax(areas <= areas.min() * (1 + EQUAL)))
    return axes[best], low_m[best], high_m[best]
