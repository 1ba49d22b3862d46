"""A mesh seen from above: its triangles on the xy plane, and the edges that bound sets of them.

A set of triangles has a boundary in the sense of chains: each directed edge counts +1, its opposite -1,
and what does not cancel is left. Two facts carry everything that is built on this:

* Turn every triangle counter-clockwise: whatever bounds their union is part of that boundary.
* Leave the triangles as they are wound: where the boundary winds around a point, the point is covered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap.geometry.tin import merge_points
from semap.model.building import Mesh

MERGE_M = 1e-7
"""Projected vertices closer than this are one: a rotated wall's top and bottom differ by float noise."""

VERTICAL = 1e-5
"""A triangle is a wall if its projection has less than this share of its area."""

PACKED_MAX = 2**31


@dataclass(frozen=True, eq=False)
class Projection:
    """Triangles on the xy plane, without those that are vertical.

    corners_m      (n, 2) [m], distinct
    triangles      (m, 3) indices of corners, counter-clockwise
    is_face_down   (m,) whether the triangle was turned for that
    height_m       (m,) height of the triangle's middle [m]
    """

    corners_m: NDArray[np.float64]
    triangles: NDArray[np.int64]
    is_face_down: NDArray[np.bool_]
    height_m: NDArray[np.float64]

    def areas_m2(self) -> NDArray[np.float64]:
        """(m,) [m2], not negative."""
        a, b, c = (self.corners_m[self.triangles[:, i]] for i in range(3))
        return np.abs(cross_2d(b - a, c - a)) / 2

    def middles_m(self) -> NDArray[np.float64]:
        """(m, 2) [m]"""
        a, b, c = (self.corners_m[self.triangles[:, i]] for i in range(3))
        middles: NDArray[np.float64] = (a + b + c) / 3
        return middles

    def subset(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Projection:
        """The same corners with only some of the triangles."""
        return Projection(self.corners_m, self.triangles[keep], self.is_face_down[keep], self.height_m[keep])


def project(mesh: Mesh) -> Projection:
    """The mesh seen from above."""
    first_m, second_m, third_m = (mesh.vertices_m[mesh.faces[:, i]] for i in range(3))
    normals = cross_3d(second_m - first_m, third_m - first_m)
    up = normals[:, 2]
    flat = np.abs(up) > VERTICAL * np.sqrt(np.einsum("ij,ij->i", normals, normals))
    is_down = up < 0
    triangles = mesh.faces.astype(np.int64, copy=True)
    triangles[is_down] = triangles[is_down, ::-1]
    places, chosen = _merged(mesh.vertices_m[:, :2])
    triangles = places[triangles]
    a, b, c = (triangles[:, i] for i in range(3))
    kept = flat & (a != b) & (b != c) & (c != a)
    height_m = (first_m[:, 2] + second_m[:, 2] + third_m[:, 2]) / 3
    return Projection(chosen, triangles[kept], is_down[kept], height_m[kept])


def cross_2d(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The z component of the cross product of vectors (n, 2)."""
    product: NDArray[np.float64] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product


def cross_3d(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cross product of vectors (..., 3); for a few of them np.cross takes ten times as long."""
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    product[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    product[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    product[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def _merged(points_m: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """For each point (n, 2) its place, and for each place one of its points, unrounded.

    An exact outline stays exact.
    """
    cells = np.round(points_m / MERGE_M)
    cells -= cells.min(axis=0, initial=np.inf) if len(cells) else 0
    if cells.max(initial=0) < PACKED_MAX:
        whole = cells.astype(np.int64)
        keys = (whole[:, 0] << 31) | whole[:, 1]
        order = np.argsort(keys, kind="stable")
        ordered = keys[order]
        is_new = np.concatenate([[True], ordered[1:] != ordered[:-1]])[: len(ordered)]
        places = np.empty(len(keys), dtype=np.int64)
        places[order] = np.cumsum(is_new) - 1
    else:
        _, places = merge_points(cells)
    chosen = np.zeros((int(places.max(initial=-1)) + 1, 2))
    chosen[places] = points_m
    return places, chosen
