"""Horizontal sections of a mesh: the boundary of its triangles above a height, and what it encloses.

The triangles above a height, as they are wound, have a boundary that folds and noise do not enter,
because they cancel: a few thousand edges, whatever the mesh. Where that boundary winds around a point,
some triangle lies above or below the point. For a closed body that is its horizontal section; a terrain
gives its whole extent.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from semap.geometry.cells import cells_between, inner_points
from semap.geometry.projection import Projection, cross_2d

MAX_EDGES = 20_000
"""A section of more edges says that the mesh is a soup; it would take long and give little."""

MAX_CELLS = 500
"""Of the areas that a section encloses, the largest."""

PAIRS_AT_ONCE = 1_000_000


class Sections:
    """The edges of a projected mesh, sorted once, so that every section is one pass over them."""

    def __init__(self, projection: Projection) -> None:
        self._corners_m = projection.corners_m
        directed = projection.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        low, high = directed.min(axis=1), directed.max(axis=1)
        # One integer for an edge: sorting integers is the fastest grouping.
        keys = low * len(self._corners_m) + high
        order = np.argsort(keys)
        keys = keys[order]
        self._starts = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]])[: len(keys)])
        self._keys = keys[self._starts]
        triangle = order // 3
        # +1 for a directed edge from the lower index to the higher, of the triangle as it lies here.
        self._turned = np.where((directed[:, 0] == low)[order], 1, -1).astype(np.int32)
        self._wound = np.where(projection.is_face_down[triangle], -self._turned, self._turned)
        self._height_m = projection.height_m[triangle]

    def borders(self) -> NDArray[np.int64]:
        """All edges (k, 2) that do not cancel when every triangle is turned counter-clockwise."""
        return self._chain(self._turned)[0]

    def region_above(self, height_m: float) -> shapely.Geometry:
        """An area that is certainly covered by triangles; empty where the mesh gives none."""
        ends, counts = self._chain(np.where(self._height_m >= height_m, self._wound, 0))
        if not 0 < len(ends) <= MAX_EDGES:
            return shapely.Polygon()
        cells = cells_between(self._corners_m[ends])
        cells = cells[np.argsort(-shapely.area(cells))[:MAX_CELLS]]
        points_m = shapely.get_coordinates(inner_points(cells))
        winding = winding_numbers(points_m, self._corners_m[ends], counts)
        return shapely.coverage_union_all(cells[winding != 0])

    def _chain(self, signs: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """Directed edges (k, 2) that do not cancel, and how often each is left."""
        if len(self._keys) == 0:
            return np.empty((0, 2), dtype=np.int64), np.empty(0, dtype=np.int32)
        balance = np.add.reduceat(signs, self._starts)
        left = np.flatnonzero(balance)
        balance = balance[left]
        ends = np.column_stack(np.divmod(self._keys[left], len(self._corners_m)))
        ends[balance < 0] = ends[balance < 0, ::-1]
        return ends, np.abs(balance)


def winding_numbers(
    points_m: NDArray[np.float64], edges_m: NDArray[np.float64], counts: NDArray[np.int32]
) -> NDArray[np.int64]:
    """How often closed chains wind around each point, counter-clockwise; by crossings of a ray.

    points_m  (n, 2), none of them on an edge
    edges_m   (k, 2, 2) from and to
    counts    (k,) multiplicities
    """
    winding = np.zeros(len(points_m), dtype=np.int64)
    start_m, end_m = edges_m[:, 0], edges_m[:, 1]
    step = max(1, PAIRS_AT_ONCE // max(len(edges_m), 1))
    for first in range(0, len(points_m), step):
        some = points_m[first : first + step, None, :]
        rises = (start_m[:, 1] <= some[..., 1]) & (end_m[:, 1] > some[..., 1])
        falls = (start_m[:, 1] > some[..., 1]) & (end_m[:, 1] <= some[..., 1])
        point, edge = np.nonzero(rises | falls)
        side = cross_2d(end_m[edge] - start_m[edge], points_m[first + point] - start_m[edge])
        turns = np.where(rises[point, edge], side > 0, -(side < 0).astype(np.int64)) * counts[edge]
        found = np.bincount(point, weights=turns, minlength=len(some))
        winding[first : first + step] = found.astype(np.int64)
    return winding
