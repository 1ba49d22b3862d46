"""Poses, areas and geometries in the YAML of a map, read and written.

A pose is `at: [x, y, z]` with `quaternion: [x, y, z, w]` or `yaw_deg`. An area is a ring of points; with
holes a list of rings; with several parts a list of those.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Point, Polygon

from semap.errors import InvalidInput
from semap.formats.map_folder import read_inside
from semap.formats.ply import is_own_ply, read_ply, read_polygon_ply
from semap.formats.yaml_node import Node
from semap.formats.yaml_text import Flow, Row, row
from semap.geometry.pose import pose_from_yaw
from semap.model.building import HeightBand, Mesh
from semap.model.pose import Pose
from semap.model.source_geometry import GeometryType, PolygonMesh, Shape, SourceGeometry

POSE_FIELDS = ("at", "yaw_deg", "quaternion")
GEOMETRY_FIELDS = ("type", "point", "polygon", "mesh", "z_m", *POSE_FIELDS)
SHAPE_FIELDS: dict[GeometryType, str] = {
    "POINT2D": "point",
    "POSE2D": "point",
    "POLYGON2D": "polygon",
    "POINT3D": "point",
    "POSE3D": "point",
    "POLYGON3D": "polygon",
    "TRIANGLEMESH3D": "mesh",
    "POLYGONMESH3D": "mesh",
}
RING, RINGS, PARTS = 1, 2, 3


def read_pose(fields: Mapping[str, Node]) -> Pose:
    """The pose that `at`, `yaw_deg` and `quaternion` give; the identity without them.

    raises  InvalidInput for both angles, or a quaternion without length
    """
    x_m, y_m, *z_m = fields["at"].numbers(2, 3) if "at" in fields else (0.0, 0.0)
    if "quaternion" in fields:
        node = fields["quaternion"]
        if "yaw_deg" in fields:
            raise node.wrong("both `yaw_deg` and `quaternion`", "Keep one.")
        quaternion = node.numbers(4, 4)
        if math.hypot(*quaternion) < 1e-9:
            raise node.wrong("a quaternion without length", "Write [x, y, z, w], such as [0, 0, 0, 1].")
        return Pose(x_m, y_m, z_m[0] if z_m else 0.0, *quaternion)
    if "yaw_deg" in fields:
        return pose_from_yaw(x_m, y_m, z_m[0] if z_m else 0.0, math.radians(fields["yaw_deg"].number()))
    return Pose(x_m, y_m, z_m[0] if z_m else 0.0)


def write_pose(pose: Pose) -> dict[str, object]:
    """The fields of a pose; those of the identity are left out."""
    parts = {"at": (pose.x_m, pose.y_m, pose.z_m), "quaternion": (pose.qx, pose.qy, pose.qz, pose.qw)}
    unsaid = {"at": (0.0, 0.0, 0.0), "quaternion": (0.0, 0.0, 0.0, 1.0)}
    # Compared as texts, since -0.0 equals 0.0.
    return {key: row(part) for key, part in parts.items() if str(row(part)) != str(row(unsaid[key]))}


def read_area(node: Node, dimension: int = 2) -> Polygon | MultiPolygon:
    """An area of points of 2 or 3 coordinates.

    raises  InvalidInput if it is none, or (in 2D) encloses no area or crosses itself
    """
    depth = _nesting(node)
    if depth == RING:
        area: Polygon | MultiPolygon = Polygon(_ring(node, dimension))
    elif depth == RINGS:
        area = _polygon(node, dimension)
    else:
        area = MultiPolygon([_polygon(part, dimension) for part in node.sequence(1)])
    if dimension == 2 and (not area.is_valid or area.area == 0):
        raise node.wrong(
            f"the outline crosses itself or encloses nothing ({shapely.is_valid_reason(area)})",
            "Give the corners one after the other, once around.",
        )
    return area


def write_area(area: Polygon | MultiPolygon) -> Row:
    """Rings without their repeated last point."""
    if isinstance(area, MultiPolygon):
        return Row(_rings(part) for part in area.geoms)
    return _rings(area) if len(area.interiors) else _points(area.exterior)


def read_geometry(name: str, node: Node, folder: Path) -> SourceGeometry:
    """One geometry of a description, in the full form."""
    fields = node.fields(GEOMETRY_FIELDS)
    if "type" not in fields:
        raise node.wrong("`type` is missing", f"Write one of {', '.join(SHAPE_FIELDS)}.")
    type_ = cast(GeometryType, fields["type"].one_of(SHAPE_FIELDS))
    key = SHAPE_FIELDS[type_]
    for other in {"point", "polygon", "mesh"} & fields.keys():
        if other != key:
            raise fields[other].wrong(f"a {type_} has no `{other}`", f"Give `{key}`.")
    band = None
    if "z_m" in fields:
        if type_ != "POLYGON2D":
            raise fields["z_m"].wrong(f"a {type_} has no heights", "Only a POLYGON2D has `z_m`.")
        band = _band(fields["z_m"])
    if key != "point" and key not in fields:
        raise node.wrong(f"`{key}` is missing", f"A {type_} needs it.")
    return SourceGeometry(name, type_, _shape(type_, fields.get(key), folder), read_pose(fields), band)


def write_geometry(source: SourceGeometry, mesh_path: str) -> dict[str, object]:
    """The full form of a geometry; a mesh is written elsewhere, at `mesh_path`."""
    fields: dict[str, object] = {"type": source.type}
    shape = source.shape
    if isinstance(shape, Mesh | PolygonMesh):
        fields["mesh"] = mesh_path
    elif isinstance(shape, Point):
        fields["point"] = row(shapely.get_coordinates(shape, include_z=shape.has_z)[0])
    else:
        fields["polygon"] = write_area(shape)
    if source.band is not None:
        fields["z_m"] = row((source.band.z_min_m, source.band.z_max_m))
    fields |= write_pose(source.pose)
    return fields if "polygon" in fields else Flow(fields)


def read_mesh_of(node: Node, folder: Path, unit: str | None = None, up: str | None = None) -> Mesh:
    """The triangles of a mesh file beside the map; those that semap wrote come back bit by bit.

    raises  NotFound, TooLarge, InvalidInput; see `semap.formats.mesh_file`
    """
    data, suffix = read_inside(folder, node)
    if is_own_ply(data) and unit is None and up is None:
        return read_ply(data, node.where)
    from semap.formats.mesh_file import read_mesh_file  # noqa: PLC0415  slow to import

    try:
        return read_mesh_file(data, suffix, unit or "file", up).mesh
    except InvalidInput as error:
        raise InvalidInput(f"{node.source}: {error}", error.remedy, node.where) from error


def _shape(type_: GeometryType, node: Node | None, folder: Path) -> Shape:
    if SHAPE_FIELDS[type_] == "point":
        dimension = 2 if type_ in ("POINT2D", "POSE2D") else 3
        return Point([0.0] * dimension if node is None else node.numbers(dimension, dimension))
    if node is None:
        raise InvalidInput("a geometry without shape", "Give one.")
    if type_ == "TRIANGLEMESH3D":
        return read_mesh_of(node, folder)
    if type_ == "POLYGONMESH3D":
        return read_polygon_ply(read_inside(folder, node)[0], node.where)
    area = read_area(node, 2 if type_ == "POLYGON2D" else 3)
    if type_ == "POLYGON3D" and not isinstance(area, Polygon):
        raise node.wrong("a POLYGON3D has one part", "Make several geometries of it.")
    return area


def _band(node: Node) -> HeightBand:
    low_m, high_m = node.numbers(2, 2)
    if not low_m < high_m:
        raise node.wrong(f"heights from {low_m} to {high_m}", "Write [lowest, highest].")
    return HeightBand(low_m, high_m)


def _nesting(node: Node) -> int:
    """How many lists lie around the points of an area."""
    depth, inner = 0, node
    while isinstance(inner.value, tuple) and inner.value:
        inner, depth = inner.value[0], depth + 1
    if depth - 1 not in (RING, RINGS, PARTS):
        raise node.wrong("an area is a list of points here", "Write [[0, 0], [4, 0], [4, 3], [0, 3]].")
    return depth - 1


def _polygon(node: Node, dimension: int) -> Polygon:
    outside, *holes = (_ring(part, dimension) for part in node.sequence(1))
    return Polygon(outside, holes)


def _ring(node: Node, dimension: int) -> NDArray[np.float64]:
    points = np.array([point.numbers(dimension, dimension) for point in node.sequence(3)])
    if (points[0] == points[-1]).all():
        points = points[:-1]
    if len(set(map(tuple, points.tolist()))) < 3:
        raise node.wrong("a ring with fewer than three different points", "Give three or more corners.")
    return np.concatenate([points, points[:1]])


def _rings(polygon: Polygon) -> Row:
    return Row(_points(ring) for ring in (polygon.exterior, *polygon.interiors))


def _points(ring: shapely.LinearRing) -> Row:
    return Row(row(point) for point in shapely.get_coordinates(ring, include_z=ring.has_z)[:-1])
