"""What the parts of the IFC reader share: the library, entities with where they are, and their shapes."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias
from uuid import NAMESPACE_URL, UUID, uuid5

import numpy as np
import shapely
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.formats.adjacency import Floor
from semap.formats.storey_band import band_by_storey
from semap.geometry.outline import outline
from semap.geometry.pose import pose_from_matrix, transform_points
from semap.model.building import Finding, HeightBand, Mesh, Storey
from semap.model.pose import IDENTITY, Pose

Entity = Any
"""An entity, or a whole file: IfcOpenShell makes their classes at run time."""

Footprint: TypeAlias = shapely.Polygon | shapely.MultiPolygon

DEPTH = 32
"""No sound model nests its spaces deeper; a model whose parts contain each other would never end."""


@dataclass(frozen=True, eq=False)
class Placed:
    """An entity with its name, its storey and, where its geometry could be made, its body and pose."""

    entity: Entity
    concept: str
    name: str
    storey: Storey | None
    pose: Pose
    body: Mesh | None

    def points_m(self) -> NDArray[np.float64]:
        """Vertices of the body, (n, 3) [m, map frame]; n = 0 without a body."""
        points_m = np.empty((0, 3)) if self.body is None else self.body.vertices_m
        return transform_points(self.pose.matrix(), points_m)


def library(name: str = "ifcopenshell") -> Any:
    """A module of IfcOpenShell.

    raises  InvalidInput if it is not installed
    """
    # It is large, and most installations never read IFC: it is an extra, imported when it is needed.
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidInput(
            "IFC files need IfcOpenShell, which is not installed", "Install it: pip install semap[ifc]"
        ) from error


def unit_scale(file: Entity, unit: str) -> float:
    """What one unit of the file is in SI units."""
    return float(library("ifcopenshell.util.unit").calculate_unit_scale(file, unit))


def shape_of(shape: Any) -> tuple[Pose, Mesh]:
    """Pose and body of a tessellated entity; IfcOpenShell gives both in metres."""
    vertices_m = np.array(shape.geometry.verts, dtype=np.float64).reshape(-1, 3)
    faces = np.array(shape.geometry.faces, dtype=np.int64).reshape(-1, 3)
    if len(faces) == 0 or not np.isfinite(vertices_m).all():
        raise InvalidInput("its geometry has no surface")
    map_T_entity = np.array(shape.transformation.matrix, dtype=np.float64).reshape(4, 4).T
    return pose_from_matrix(map_T_entity), Mesh(vertices_m, faces)


def whole_shape(parts: Sequence[Entity]) -> tuple[Pose, Mesh | None]:
    """One body of several entities, in a frame at the lowest corner of it."""
    geom = library("ifcopenshell.geom")
    settings = geom.settings()
    vertices_m, faces, start = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
    for part in parts:
        try:
            pose, body = shape_of(geom.create_shape(settings, part))
        except (RuntimeError, InvalidInput):
            continue
        vertices_m.append(transform_points(pose.matrix(), body.vertices_m))
        faces.append(body.faces + start)
        start += len(body.vertices_m)
    if start == 0:
        return IDENTITY, None
    corners_m = np.concatenate(vertices_m)
    origin_m = corners_m.min(axis=0)
    return Pose(*(float(each) for each in origin_m)), Mesh(corners_m - origin_m, np.concatenate(faces))


def placement(entity: Entity) -> NDArray[np.float64]:
    """The matrix (4, 4) of a placement in its parent, or an object's in the world, in units of the file."""
    module = library("ifcopenshell.util.placement")
    local = module.get_axis2placement if entity.is_a("IfcPlacement") else module.get_local_placement
    matrix: NDArray[np.float64] = local(entity)
    return matrix


def storey_of(entity: Entity, storeys: Mapping[int, Storey]) -> Storey | None:
    """The storey that contains an entity, directly or through what it is part of."""
    element = library("ifcopenshell.util.element")
    for _ in range(DEPTH):
        if entity is None or entity.id() in storeys:
            break
        entity = element.get_aggregate(entity) or element.get_container(entity, should_get_direct=True)
    return None if entity is None else storeys.get(entity.id())


def band_of(placed: Placed, elevations_m: Sequence[float]) -> HeightBand | None:
    """Rooms follow their storey; a door's heights are those of its body."""
    if placed.body is None or placed.concept != "Room":
        return None
    heights_m = placed.points_m()[:, 2]
    elevation_m = None if placed.storey is None else placed.storey.elevation_m
    return band_by_storey(float(heights_m.min()), float(heights_m.max()), elevation_m, elevations_m)


def footprints_of(placed: Sequence[Placed], findings: list[Finding]) -> dict[str, Footprint]:
    """Outlines of rooms by name [m, map frame]."""
    footprints: dict[str, Footprint] = {}
    for room in placed:
        if room.concept == "Room" and room.body is not None:
            try:
                footprints[room.name] = outline(Mesh(room.points_m(), room.body.faces))
            except InvalidInput as error:
                findings.append(Finding("note", room.name, f"its ways are not found by shape: {error}"))
    return footprints


def floors_of(placed: Sequence[Placed], footprints: Mapping[str, Footprint]) -> dict[Storey | None, Floor]:
    """The rooms of each storey on which something is placed."""
    on: dict[Storey | None, dict[str, Footprint]] = {each.storey: {} for each in placed}
    for each in placed:
        if each.name in footprints:
            on[each.storey][each.name] = footprints[each.name]
    return {storey: Floor(rooms) for storey, rooms in on.items()}


def uid_of(entity: Entity) -> UUID | None:
    """An entity's GlobalId as a UUID; None where it is malformed."""
    try:
        return UUID(library("ifcopenshell.guid").expand(entity.GlobalId))
    except (ValueError, TypeError, library().Error):
        return None


def made_uid(entity: Entity) -> UUID:
    """A UUID from an entity's place in its file."""
    return uuid5(NAMESPACE_URL, f"ifc {entity.GlobalId} {entity.id()}")
