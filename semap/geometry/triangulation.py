"""Source geometries as triangles, in the frame of their description."""

from __future__ import annotations

import mapbox_earcut
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon

from semap.errors import InvalidInput
from semap.geometry.pose import transform_mesh, transform_points
from semap.geometry.prism import extrude, require_prism
from semap.model.building import Mesh
from semap.model.pose import IDENTITY
from semap.model.source_geometry import PolygonMesh, SourceGeometry

PLANAR = 1e-3
"""A polygon is planar if no corner is farther from its plane than this share of its extent."""


def triangles(source: SourceGeometry) -> Mesh | None:
    """The surface of a source geometry in its description's frame; None where it has none.

    A POLYGON2D with heights is the prism over it, one without is no surface.
    raises  InvalidInput for a mesh without triangles or with corners that are not finite, a polygon that
            is not planar, heights that do not rise
    """
    shape = source.shape
    if isinstance(shape, Mesh):
        mesh = _checked(shape)
    elif isinstance(shape, PolygonMesh):
        mesh = _checked(triangulated(shape))
    elif source.type == "POLYGON3D" and isinstance(shape, Polygon):
        mesh = _checked(_triangulated_polygon(shape))
    elif source.band is not None and isinstance(shape, Polygon | MultiPolygon):
        mesh = extrude(shapely.force_2d(shape), source.band.z_min_m, source.band.z_max_m)
    else:
        return None
    return mesh if source.pose == IDENTITY else transform_mesh(source.pose.matrix(), mesh)


def prism_heights(source: SourceGeometry) -> tuple[float, float] | None:
    """Lowest and highest of the prism over a POLYGON2D in its description's frame [m]; None without heights.

    raises  InvalidInput as `extrude` does
    """
    if source.band is None or not isinstance(source.shape, Polygon | MultiPolygon):
        return None
    ends_m = (source.band.z_min_m, source.band.z_max_m)
    require_prism(source.shape, *ends_m)
    up = source.pose.matrix()[2]
    ground_m = shapely.get_coordinates(source.shape) @ up[:2]
    rises_m = [up[2] * end_m + up[3] for end_m in ends_m]
    return float(ground_m.min() + min(rises_m)), float(ground_m.max() + max(rises_m))


def points(source: SourceGeometry) -> NDArray[np.float64]:
    """The corners (n, 3) of a source geometry in its description's frame; 2D ones lie at its height 0."""
    surface = None if source.type == "POLYGON2D" else triangles(source)
    if surface is not None:
        return used_vertices(surface)
    if isinstance(source.shape, Mesh | PolygonMesh):
        return np.empty((0, 3))
    coordinates = shapely.get_coordinates(source.shape, include_z=True)
    if not np.isfinite(coordinates[:, :2]).all():
        raise InvalidInput("a coordinate that is not finite", "Give finite coordinates.", source.name)
    return transform_points(source.pose.matrix(), np.nan_to_num(coordinates))


def used_vertices(mesh: Mesh) -> NDArray[np.float64]:
    """The vertices (n, 3) that some triangle uses."""
    is_used = np.zeros(len(mesh.vertices_m), dtype=bool)
    is_used[mesh.faces] = True
    used: NDArray[np.float64] = mesh.vertices_m[is_used]
    return used


def triangulated(mesh: PolygonMesh) -> Mesh:
    """The same surface in triangles that use the same vertices.

    raises  InvalidInput if a face is not planar or names a vertex that is not there
    """
    faces = [face_triangles(mesh.vertices_m, np.array(face, dtype=np.int64)) for face in mesh.faces]
    return Mesh(mesh.vertices_m, np.concatenate(faces) if faces else np.empty((0, 3), dtype=np.int64))


def face_triangles(vertices_m: NDArray[np.float64], corners: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles (m, 3) of a polygon in space that is given by indices of its corners.

    raises  InvalidInput if it is not planar, has fewer than three corners or names one that is not there
    """
    if len(corners) < 3 or corners.min() < 0 or corners.max() >= len(vertices_m):
        raise InvalidInput(
            "a face with fewer than three corners, or one that names a vertex that is not there",
            "Export the mesh again.",
        )
    if len(corners) == 3:
        return corners[None]
    return corners[_cut(vertices_m[corners], [len(corners)])]


def _triangulated_polygon(polygon: Polygon) -> Mesh:
    rings = [
        shapely.get_coordinates(ring, include_z=True)[:-1] for ring in (polygon.exterior, *polygon.interiors)
    ]
    corners_m = np.nan_to_num(np.concatenate(rings))
    return Mesh(corners_m, _cut(corners_m, np.cumsum([len(ring) for ring in rings]).tolist()))


def _cut(corners_m: NDArray[np.float64], ends: list[int]) -> NDArray[np.int64]:
    """Triangles (m, 3) of a planar polygon whose first ring is its outside, wound as that ring."""
    ring_m = corners_m[: ends[0]] - corners_m[0]
    # Newell: the area vector of a polygon in space.
    normal = np.cross(ring_m, np.roll(ring_m, -1, axis=0)).sum(axis=0)
    length = float(np.linalg.norm(normal))
    if length == 0:
        return np.empty((0, 3), dtype=np.int64)
    offsets_m = (corners_m - corners_m[0]) @ (normal / length)
    if np.ptp(offsets_m) > PLANAR * float(np.ptp(corners_m, axis=0).max()):
        raise InvalidInput("a polygon whose corners do not lie in one plane", "Give it as triangles.")
    across = np.cross(normal / length, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    flat = corners_m @ np.column_stack([across, np.cross(normal / length, across)])
    found = mapbox_earcut.triangulate_float64(flat, np.array(ends, dtype=np.uint32)).reshape(-1, 3)
    faces = found.astype(np.int64)
    a, b, c = (flat[faces[:, i]] for i in range(3))
    is_back = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) < (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    faces[is_back] = faces[is_back, ::-1]
    return faces


def _checked(mesh: Mesh) -> Mesh:
    if len(mesh.faces) == 0:
        raise InvalidInput("a mesh without triangles", "Export the surface of the body, not only its points.")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices_m):
        raise InvalidInput("a triangle names a vertex that is not there", "Export the mesh again.")
    if not np.isfinite(mesh.vertices_m).all() and not np.isfinite(used_vertices(mesh)).all():
        raise InvalidInput("a vertex is not finite (NaN or infinite)", "Repair the mesh before using it.")
    return mesh
