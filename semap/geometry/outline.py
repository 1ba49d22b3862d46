"""The outline of a mesh seen from above.

To unite a million triangles one by one takes most of a minute. But where two triangles that both face
up (or both down) share an edge, that edge is inside the union; only the others can be part of the
outline. So:

1. project, drop what is vertical, turn every triangle counter-clockwise;
2. cancel each directed edge against its opposite: what is left are silhouettes and open borders;
3. drop those that lie inside a region that is certainly covered (`semap.geometry.cover`);
4. cut the plane along the others and keep the cells that some triangle covers;
5. unite the cells, close hairlines, drop collinear vertices.

Nothing here needs a watertight or consistently wound mesh; both make it faster.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, STRtree

from semap.errors import InvalidInput
from semap.geometry.cells import cells_between, inner_points
from semap.geometry.cover import uncovered
from semap.geometry.grid import bounds_of, grid_over, point_counts, prefix_sums
from semap.geometry.projection import Projection, project
from semap.geometry.section import Sections
from semap.model.building import Mesh

HAIRLINE_M = 1e-4
"""Gaps narrower than twice this are closed."""

COLLINEAR_M = 1e-6
"""A vertex whose removal moves the outline by less than this is dropped."""

FEW = 1000
"""So many triangles are made polygons in less time than it takes to make a grid."""

LARGEST_FIRST = (20_000, 100_000)
"""The largest triangles cover most cells; the small ones are asked only about what is left."""


def outline(mesh: Mesh) -> Polygon | MultiPolygon:
    """The outline of all triangles of the mesh projected on the xy plane, concave, with its holes.

    raises  InvalidInput if the projection has no area
    """
    projection = project(mesh)
    cells = cells_between(projection.corners_m[uncovered(projection, Sections(projection))])
    covered = cells[_is_covered(cells, projection)]
    # The cells share their edges exactly, as a coverage must.
    footprint = _tidied(shapely.coverage_union_all(covered))
    if footprint.is_empty:
        raise InvalidInput(
            "seen from above, the mesh has no area: it has walls but neither floor nor ceiling",
            "Export the room as a closed body, or give its outline as a polygon.",
        )
    return footprint


def _is_covered(cells: NDArray[np.object_], projection: Projection) -> NDArray[np.bool_]:
    """Which cells lie under a triangle; no border crosses a cell, so that one point speaks for all of it."""
    covered = np.zeros(len(cells), dtype=bool)
    points = inner_points(cells)
    largest_first = np.argsort(-projection.areas_m2())
    start = 0
    for end in (*LARGEST_FIRST, len(largest_first)):
        left = np.flatnonzero(~covered)
        some = projection.triangles[largest_first[start:end]]
        if len(left) > 0 and len(some) > 0:
            covered[left[_met(points[left], projection.corners_m[some])]] = True
        start = end
    return covered


def _met(points: NDArray[np.object_], corners_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices of the points that some triangle (m, 3, 2) holds."""
    if len(corners_m) > FEW:
        # Most triangles of a scan have no point near them; to make polygons of all takes seconds.
        places_m = shapely.get_coordinates(points)
        grid = grid_over(places_m)
        sums = prefix_sums(point_counts(grid, places_m))
        corners_m = corners_m[grid.counts_in(sums, *bounds_of(corners_m)) > 0]
    shapes = shapely.polygons(corners_m[:, [0, 1, 2, 0]])
    met: NDArray[np.int64] = STRtree(points).query(shapes, predicate="intersects")[1]
    return met


def _tidied(footprint: shapely.Geometry) -> Polygon | MultiPolygon:
    exact = _without_collinear(footprint)
    # GEOS divides by the length of slivers, and goes on.
    with np.errstate(all="ignore"):
        wider = footprint.buffer(HAIRLINE_M, join_style="mitre")
        closed = _without_collinear(wider.buffer(-HAIRLINE_M, join_style="mitre"))
    # Closing shifts every vertex by float noise and blunts sharp corners, which adds vertices; only
    # where it removed some was there a gap to close.
    return closed if shapely.get_num_coordinates(closed) < shapely.get_num_coordinates(exact) else exact


def _without_collinear(footprint: shapely.Geometry) -> Polygon | MultiPolygon:
    parts = [
        part
        for part in shapely.get_parts(shapely.make_valid(footprint.simplify(COLLINEAR_M)))
        if isinstance(part, Polygon) and part.area > HAIRLINE_M * part.length / 2
    ]
    return parts[0] if len(parts) == 1 else MultiPolygon(parts)
