"""Edges that cannot be part of an outline, because something certainly covers them.

A scan with noise folds at every third edge, a furnished building overlaps itself at every edge: hundreds
of thousands of silhouettes, nearly all of them above or below something else. To cut the plane along all
of them takes minutes. Here regions are found that are certainly covered (horizontal sections, the
largest triangles), and the edges strictly inside them are dropped.

Dropping is exact: a cell of what is left is covered as a whole or not at all, because no border of the
union runs inside a covered region. How much is dropped is luck, and only a matter of time.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray

from semap.geometry.grid import bounds_of, classified, grid_over, prefix_sums
from semap.geometry.projection import Projection
from semap.geometry.section import Sections
from semap.geometry.union import united

ENOUGH = 10_000
"""So few edges are cut faster than thinned out."""

ROUNDS = 12
HEIGHTS = 8
LARGEST = 4_000
MUCH = 0.6
"""Sections that leave more than this share of the edges call for the largest triangles."""

LITTLE = 0.85
"""A round that leaves more than this share is the last."""

MARGIN_M = 1e-6
"""How far inside a region an edge must be: far above float noise, far below any gap."""


def uncovered(projection: Projection, sections: Sections) -> NDArray[np.int64]:
    """The border edges (k, 2) without those that lie in the interior of the union of all triangles."""
    borders = sections.borders()
    if len(borders) <= ENOUGH:
        return borders
    active = projection
    heights_m = _widest(projection)
    for _ in range(ROUNDS):
        before = len(borders)
        region = united([sections.region_above(height_m) for height_m in heights_m])
        borders, active = _thinned(projection, borders, active, region)
        if len(borders) > max(ENOUGH, MUCH * before) and len(active.triangles) > 0:
            borders, active = _thinned(projection, borders, active, _largest(active))
        if not ENOUGH < len(borders) <= LITTLE * before or len(active.triangles) == 0:
            break
        heights_m = np.quantile(active.height_m, (np.arange(HEIGHTS) + 0.5) / HEIGHTS)
    return borders


def _thinned(
    projection: Projection, borders: NDArray[np.int64], active: Projection, region: shapely.Geometry
) -> tuple[NDArray[np.int64], Projection]:
    """Borders and triangles without those inside a region."""
    if region.is_empty:
        return borders, active
    grid = grid_over(shapely.get_coordinates(region))
    touched, inside = classified(grid, region, MARGIN_M)
    ends_m = projection.corners_m[borders]
    low_m, high_m = bounds_of(ends_m)
    is_clear = grid.counts_in(prefix_sums((~inside).astype(np.int64)), low_m, high_m) == 0
    is_near = grid.counts_in(prefix_sums(touched.astype(np.int64)), low_m, high_m) > 0
    near = np.flatnonzero(is_near)
    # GEOS divides by the length of slivers, and goes on.
    with np.errstate(all="ignore"):
        shrunk = region.buffer(-MARGIN_M, join_style="mitre")
    shapely.prepare(shrunk)
    is_clear[near] = shapely.contains_properly(shrunk, shapely.linestrings(ends_m[near]))
    middles = grid.cells_of(active.middles_m()) + 1
    return borders[~is_clear], active.subset(~inside[middles[:, 0], middles[:, 1]])


def _widest(projection: Projection) -> NDArray[np.float64]:
    """The height whose section has the largest area, if everything is wound consistently."""
    signed_m2 = np.where(projection.is_face_down, -1.0, 1.0) * projection.areas_m2()
    downwards = np.argsort(-projection.height_m)
    best = downwards[np.argmax(np.abs(np.cumsum(signed_m2[downwards])))]
    return projection.height_m[[best]]


def _largest(active: Projection) -> shapely.Geometry:
    areas_m2 = active.areas_m2()
    count = min(LARGEST, len(areas_m2))
    chosen = np.argpartition(areas_m2, -count)[-count:]
    return united(shapely.polygons(active.corners_m[active.triangles[chosen][:, [0, 1, 2, 0]]]))
