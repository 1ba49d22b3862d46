"""The outline of a mesh seen from above.

To unite a million triangles one by one takes most of a minute. But where two triangles that both face
up (or both down) share an edge, that edge is inside the union; only the others, a small share, can be
part of the outline. So:

1. project, drop what is vertical, turn every triangle counter-clockwise;
2. cancel each directed edge against its opposite: what is left are silhouettes and open borders;
3. cut the plane along these and keep the cells that some triangle covers;
4. unite the cells, close hairlines, drop collinear vertices.

Nothing here needs a watertight or consistently wound mesh.
"""

from __future__ import annotations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon, STRtree

from semap.errors import InvalidInput
from semap.geometry.tin import merge_points
from semap.model.building import Mesh

MERGE_M = 1e-7
"""Projected vertices closer than this are one: a rotated wall's top and bottom differ by float noise."""

HAIRLINE_M = 1e-4
"""Gaps narrower than twice this are closed."""

COLLINEAR_M = 1e-6
"""A vertex whose removal moves the outline by less than this is dropped."""

VERTICAL = 1e-5
"""A triangle is a wall if its projection has less than this share of its area."""


def outline(mesh: Mesh) -> Polygon | MultiPolygon:
    """The outline of all triangles of the mesh projected on the xy plane, concave, with its holes.

    raises  InvalidInput if the projection has no area
    """
    corners, triangles = _projected(mesh)
    cells = shapely.get_parts(shapely.polygonize(shapely.get_parts(_borders(corners, triangles))))
    covered = cells[_is_covered(cells, corners, triangles)]
    # The cells share their edges exactly, as a coverage must.
    footprint = _tidied(shapely.coverage_union_all(covered))
    if footprint.is_empty:
        raise InvalidInput(
            "seen from above, the mesh has no area: it has walls but neither floor nor ceiling",
            "Export the room as a closed body, or give its outline as a polygon.",
        )
    return footprint


def _projected(mesh: Mesh) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Distinct projected vertices (n, 2) and counter-clockwise triangles (m, 3) that are not vertical."""
    corners_m = mesh.vertices_m[mesh.faces]
    normals = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    up = normals[:, 2]
    flat = np.abs(up) > VERTICAL * np.linalg.norm(normals, axis=1)
    triangles = np.where((up > 0)[:, None], mesh.faces, mesh.faces[:, ::-1])[flat]
    vertices = mesh.vertices_m[:, :2]
    _, places = merge_points(np.round(vertices / MERGE_M))
    # One vertex stands for its whole place, unrounded: an exact outline stays exact.
    chosen = np.zeros((int(places.max(initial=-1)) + 1, 2))
    chosen[places] = vertices
    triangles = places[triangles]
    a, b, c = (triangles[:, i] for i in range(3))
    return chosen, triangles[(a != b) & (b != c) & (c != a)]


def _borders(corners: NDArray[np.float64], triangles: NDArray[np.int64]) -> shapely.Geometry:
    """The edges that do not cancel, cut where they cross."""
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = directed.min(axis=1), directed.max(axis=1)
    keys, edges = np.unique(low * len(corners) + high, return_inverse=True)
    balance = np.bincount(edges, weights=np.where(directed[:, 0] == low, 1.0, -1.0), minlength=len(keys))
    left = keys[balance != 0]
    if len(left) == 0:
        return shapely.MultiLineString()
    ends = np.column_stack([left // len(corners), left % len(corners)])
    return shapely.union_all(shapely.linestrings(corners[ends]))


def _is_covered(
    cells: NDArray[np.object_], corners: NDArray[np.float64], triangles: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Which cells lie under a triangle; no border crosses a cell, so that one point speaks for all of it."""
    covered = np.zeros(len(cells), dtype=bool)
    if len(cells) > 0:
        points = STRtree(shapely.point_on_surface(cells))
        shapes = shapely.polygons(corners[triangles[:, [0, 1, 2, 0]]])
        covered[points.query(shapes, predicate="intersects")[1]] = True
    return covered


def _tidied(footprint: shapely.Geometry) -> Polygon | MultiPolygon:
    exact = _without_collinear(footprint)
    closed = _without_collinear(
        footprint.buffer(HAIRLINE_M, join_style="mitre").buffer(-HAIRLINE_M, join_style="mitre")
    )
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
