"""What is derived from the geometries of a description, so that questions of space need not read them.

The names are those of SEMAP's abstractions; `Footprint` is the true outline, concave where the body is.
All are in the frame of the description.

* The flat ones (Footprint, FootprintHull, FootprintBox, AxisAligned2D, Position2D) are those of its
  POLYGON2Ds if it has any, else of its surfaces seen from above, else of its points.
* The others (Position3D, AxisAligned3D, BoundingBox, BoundingHull) are those of its surfaces: meshes and
  polygons in space, else the prisms over POLYGON2Ds with heights, else its POINT3Ds and POSE3Ds.
* POINT2D, POSE2D and POLYGON2Ds without heights say nothing about space; points beside a surface are marks
  on the body and do not enlarge it.

What has no extent is left out, and nothing else: seen from above a wall has a Position2D but no area;
points on one line have a Position3D but no hull and no boxes. What lies in one plane has a hull of two
sides and boxes without thickness. Footprint needs a surface or a POLYGON2D.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Point, Polygon

from semap.errors import InvalidInput
from semap.geometry.hull import centroid, convex_hull
from semap.geometry.oriented_box import box_mesh, smallest_box, smallest_rectangle
from semap.geometry.outline import outline
from semap.geometry.pose import transform_points
from semap.geometry.triangulation import points, prism_heights, triangles, used_vertices
from semap.geometry.union import united
from semap.geometry.upright import upright
from semap.model.building import Mesh
from semap.model.pose import IDENTITY
from semap.model.source_geometry import BODY, SourceGeometry

MIN_AREA_M2 = 1e-12
SURFACES_3D = ("POLYGON3D", "TRIANGLEMESH3D", "POLYGONMESH3D")
FARTHEST_M = 1e8
"""Farther than anything on earth from the origin of a metric system."""

POINTS_3D = ("POINT3D", "POSE3D")


@dataclass(frozen=True, eq=False)
class Abstraction:
    """One derived geometry, in the frame of its description, and the heights over which it holds.

    geometry          BoundingHull and boxes: a closed Mesh, wound outwards; Position3D with z; others flat
    z_min_m, z_max_m  extent of the whole; None: it has no height, or holds at every height
    """

    type: str
    geometry: shapely.Geometry | Mesh
    z_min_m: float | None
    z_max_m: float | None


def derive(sources: Sequence[SourceGeometry] | Mesh) -> tuple[Abstraction, ...]:
    """Every abstraction that the geometries of one description give, one of each type at most.

    raises  InvalidInput if a geometry is none (see `semap.geometry.triangulation.triangles`), lies beyond
            `FARTHEST_M`, or is so thin that it has no hull in floating point
    """
    if isinstance(sources, Mesh):
        sources = (SourceGeometry(BODY, "TRIANGLEMESH3D", sources),)
    areas = [each for each in sources if each.type == "POLYGON2D"]
    surface = _joined([each for each in sources if each.type in SURFACES_3D]) or _joined(areas)
    if surface is None:
        spots_m = _all_points([each for each in sources if each.type in POINTS_3D])
    else:
        spots_m = used_vertices(surface)
    flat_m = [shapely.get_coordinates(each.shape) for each in areas]
    if any(np.abs(each).max(initial=0) > FARTHEST_M for each in (spots_m, *flat_m)):
        raise InvalidInput(
            f"coordinates beyond {FARTHEST_M:g} m", "Mind the unit, or anchor the map to the earth."
        )
    heights_m = _heights(spots_m)
    bodies = _in_space(spots_m, surface) if len(spots_m) else {}
    in_space = tuple(Abstraction(type_, shape, *heights_m) for type_, shape in bodies.items())
    hull = bodies.get("BoundingHull")
    if areas:
        flat = _flat_of_area(_united(areas))
        heights_m = _bands(areas) or heights_m
    elif surface is not None and isinstance(hull, Mesh):
        flat = _flat_of_surface(surface, hull.vertices_m)
    else:
        marks_m = spots_m if len(spots_m) else _all_points(sources)
        flat = _flat_of_points(marks_m) if len(marks_m) else []
    return (*(Abstraction(type_, shape, *heights_m) for type_, shape in flat), *in_space)


def _in_space(spots_m: NDArray[np.float64], surface: Mesh | None) -> dict[str, shapely.Geometry | Mesh]:
    """Of points (n, 3), n >= 1, and the surface that they are of, if they are."""
    stands = upright(spots_m)
    if stands is not None:
        return {
            "Position3D": stands.centroid(),
            "AxisAligned3D": stands.axis_aligned_box(),
            "BoundingBox": stands.smallest_box(),
            "BoundingHull": stands.hull(),
        }
    from scipy.spatial import QhullError  # noqa: PLC0415  slow to import

    try:
        hull = convex_hull(spots_m, surface)
    except QhullError as error:
        raise InvalidInput(
            "a shape that is too thin for its size to have a hull", "Mind the unit, and repair the mesh."
        ) from error
    if hull is None:
        return {"Position3D": Point(_middle(spots_m))}
    return {
        "Position3D": Point(centroid(hull)),
        "AxisAligned3D": box_mesh(spots_m.min(axis=0), spots_m.max(axis=0)),
        "BoundingBox": smallest_box(hull),
        "BoundingHull": hull,
    }


def _flat_of_area(area: Polygon | MultiPolygon) -> list[tuple[str, shapely.Geometry]]:
    around = _flat_around(area)
    return [("Footprint", area), *around] if area.area > MIN_AREA_M2 else around


def _flat_of_surface(surface: Mesh, hull_m: NDArray[np.float64]) -> list[tuple[str, shapely.Geometry]]:
    around = _flat_of_points(hull_m)
    if len(around) == 1:
        return around
    try:
        return [("Footprint", outline(surface)), *around]
    except InvalidInput:
        # Four walls without floor or ceiling enclose an area but cover none.
        return around


def _flat_of_points(points_m: NDArray[np.float64]) -> list[tuple[str, shapely.Geometry]]:
    """Of points (n, 2 or 3), n >= 1."""
    return _flat_around(shapely.multipoints(points_m[:, :2]))


def _flat_around(shape: shapely.Geometry) -> list[tuple[str, shapely.Geometry]]:
    if shape.is_empty:
        return []
    around = shapely.convex_hull(shape)
    if not isinstance(around, Polygon) or around.area <= MIN_AREA_M2:
        return [("Position2D", Point(_middle(shapely.get_coordinates(shape))))]
    corners_m = shapely.get_coordinates(around)[:-1]
    return [
        ("FootprintHull", around),
        ("FootprintBox", Polygon(smallest_rectangle(corners_m))),
        ("AxisAligned2D", shapely.box(*around.bounds)),
        ("Position2D", around.centroid),
    ]


def _middle(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middle of the segment that collinear points (n, d) span."""
    far_m = points_m[np.argmax(np.linalg.norm(points_m - points_m[0], axis=1))]
    other_m = points_m[np.argmax(np.linalg.norm(points_m - far_m, axis=1))]
    middle_m: NDArray[np.float64] = (far_m + other_m) / 2
    return middle_m


def _joined(sources: Sequence[SourceGeometry]) -> Mesh | None:
    """One mesh of all surfaces."""
    meshes = [mesh for mesh in map(triangles, sources) if mesh is not None]
    if len(meshes) <= 1:
        return meshes[0] if meshes else None
    starts = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]),
    )


def _all_points(sources: Sequence[SourceGeometry]) -> NDArray[np.float64]:
    return np.concatenate([np.empty((0, 3)), *map(points, sources)])


def _united(areas: Sequence[SourceGeometry]) -> Polygon | MultiPolygon:
    """The areas of POLYGON2Ds; one with a tilted pose is seen from above."""
    placed = []
    for each in areas:
        flat = shapely.force_2d(each.shape)
        if each.pose != IDENTITY:
            matrix = each.pose.matrix()
            flat = shapely.transform(
                flat,
                lambda xy, matrix=matrix: transform_points(matrix, np.column_stack([xy, np.zeros(len(xy))]))[
                    :, :2
                ],
            )
        placed.append(flat)
    whole = placed[0] if len(placed) == 1 else united(placed)
    if isinstance(whole, Polygon | MultiPolygon):
        return whole
    return MultiPolygon([part for part in shapely.get_parts(whole) if isinstance(part, Polygon)])


def _heights(points_m: NDArray[np.float64]) -> tuple[float | None, float | None]:
    """None where there is no height between lowest and highest."""
    if len(points_m) == 0 or not points_m[:, 2].min() < points_m[:, 2].max():
        return None, None
    return float(points_m[:, 2].min()), float(points_m[:, 2].max())


def _bands(areas: Sequence[SourceGeometry]) -> tuple[float, float] | None:
    """The heights of the areas; None where they give none."""
    bands = [band for band in map(prism_heights, areas) if band is not None]
    if len(bands) < len(areas):
        return None
    return min(low_m for low_m, _ in bands), max(high_m for _, high_m in bands)
