"""Surfaces and solids of GML as triangle meshes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.polygon import orient

from semap.errors import InvalidInput
from semap.formats.gml_tree import XLINK, child, children, name_of, points_of, referred
from semap.geometry.tin import merge_points
from semap.geometry.triangulation import triangles
from semap.model.building import Mesh
from semap.model.source_geometry import SourceGeometry

POLYGONS = ("Polygon", "PolygonPatch", "Triangle", "Rectangle")
MAX_REFERENCES = 32
EXCESS = 1e-6
"""How much more area than its winding says a polygon's triangles may have."""

Rings = tuple[NDArray[np.float64], ...]


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of a geometry, None where it has none, and how many of its polygons were no sound ones.

    bent      not flat; cut from their first corner
    crossing  crossing or touching themselves; what they enclose an odd number of times is kept
    """

    mesh: Mesh | None
    bent: int = 0
    crossing: int = 0


def surface_of(
    element: Element, ids: Mapping[str, Element], scale: float, origin_m: NDArray[np.float64], where: str
) -> Surface:
    """The triangles of all polygons of a geometry.

    scale     metres for one unit of the file
    origin_m  (3,), what becomes zero
    raises    InvalidInput for positions that are none
    """
    corners: list[NDArray[np.float64]] = []
    bent, crossing = 0, 0
    for rings in polygons_of(element, ids, where):
        if any(len(ring) < 4 for ring in rings):
            continue
        shifted = [ring * scale - origin_m for ring in rings]
        found = _triangles(shifted)
        if found is None:
            bent += 1
            found = _fan(shifted[0])
        elif _area_m2(found) > (1 + EXCESS) * _net_area_m2(shifted):
            crossing += 1
            parts = (_triangles(part) for part in _simple_parts(shifted))
            found = np.concatenate([np.empty((0, 3, 3)), *(part for part in parts if part is not None)])
        corners.append(found)
    if not sum(len(each) for each in corners):
        return Surface(None, bent, crossing)
    vertices_m, indices = merge_points(np.concatenate(corners).reshape(-1, 3))
    faces = indices.reshape(-1, 3)
    is_degenerate = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return Surface(Mesh(vertices_m, faces[~is_degenerate]), bent, crossing)


def polygons_of(
    element: Element, ids: Mapping[str, Element], where: str, flipped: bool = False, references: int = 0
) -> Iterator[Rings]:
    """The rings of every polygon below an element, closed, the outside first; references are followed."""
    if (target := referred(element, ids)) is not None and len(element) == 0:
        if references >= MAX_REFERENCES:
            raise InvalidInput("geometries that refer to each other", "Export it again.", where)
        yield from polygons_of(target, ids, where, flipped, references + 1)
    elif element.get(f"{XLINK}href") is not None and len(element) == 0:
        raise InvalidInput(
            f"the geometry {element.get(f'{XLINK}href')} is not in this file",
            "Export it with all parts.",
            where,
        )
    elif name_of(element) in POLYGONS:
        rings = tuple(
            points_of(ring, where)
            for side in (*children(element, "exterior"), *children(element, "interior"))
            for ring in side
        )
        if rings:
            yield tuple(ring[::-1] for ring in rings) if flipped else rings
    else:
        is_turned = name_of(element) == "OrientableSurface" and element.get("orientation") == "-"
        for part in element:
            yield from polygons_of(part, ids, where, flipped ^ is_turned, references)


def geometry_of(element: Element, *names: str) -> Element | None:
    """What lies inside the first child of some names, past the wrappers Geometry2D and Geometry3D."""
    found = child(element, *names)
    while found is not None and name_of(found) in (*names, "Geometry2D", "Geometry3D"):
        if len(found) == 0:
            return found if found.get(f"{XLINK}href") is not None else None
        found = found[0]
    return found


def _area_m2(corners: NDArray[np.float64]) -> float:
    """Of triangles (n, 3, 3)."""
    sides = corners[:, 1:] - corners[:, :1]
    return float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum() / 2)


def _net_area_m2(rings: list[NDArray[np.float64]]) -> float:
    """What the rings enclose, by their winding; less than their triangles where they cross themselves."""
    outside, *holes = (float(np.linalg.norm(_area_vector(ring))) for ring in rings)
    return outside - sum(holes)


def _area_vector(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """Newell: half the sum of the cross products, normal to the ring and as long as its area."""
    near = ring - ring[0]
    vector: NDArray[np.float64] = np.cross(near[:-1], near[1:]).sum(axis=0) / 2
    return vector


def _simple_parts(rings: list[NDArray[np.float64]]) -> list[list[NDArray[np.float64]]]:
    """The rings of the simple polygons that make up one that crosses itself."""
    normal = _area_vector(rings[0])
    if not normal.any():
        return []
    normal /= np.linalg.norm(normal)
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    plane = np.column_stack([across, np.cross(normal, across)])
    flat = [(ring - rings[0][0]) @ plane for ring in rings]
    polygon = Polygon(flat[0], flat[1:])
    given = {
        tuple(point): corner
        for points, ring in zip(flat, rings, strict=True)
        for point, corner in zip(points.tolist(), ring, strict=True)
    }

    def in_space(ring: shapely.LinearRing) -> NDArray[np.float64]:
        points = shapely.get_coordinates(ring).tolist()
        return np.array([given.get(tuple(point), rings[0][0] + plane @ point) for point in points])

    parts = shapely.get_parts(shapely.get_parts(shapely.make_valid(polygon)))
    polygons = [each for each in parts if isinstance(each, Polygon)]
    return [
        [in_space(ring) for ring in (each.exterior, *each.interiors)]
        for each in (orient(each) for each in polygons)
    ]


def _triangles(rings: list[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """(n, 3, 3), or None where the polygon is not flat."""
    try:
        mesh = triangles(SourceGeometry("face", "POLYGON3D", Polygon(rings[0], rings[1:])))
    except InvalidInput as error:
        return np.empty((0, 3, 3)) if "without triangles" in str(error) else None
    return np.empty((0, 3, 3)) if mesh is None else mesh.vertices_m[mesh.faces]


def _fan(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3, 3), the triangles from the first corner to each edge."""
    second, third = ring[1:-2], ring[2:-1]
    return np.stack([np.broadcast_to(ring[0], second.shape), second, third], axis=1)
