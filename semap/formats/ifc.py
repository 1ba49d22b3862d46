"""Building models in IFC (ISO 16739; IFC2X3 and IFC4), read with IfcOpenShell.

IfcBuildingStorey becomes a storey, IfcSpace a Room, IfcDoor a Door, IfcWindow a Window, and whatever lies
below IfcFurnishingElement Furniture; attributes keep the entity's own class and type. All lengths are
converted to metres. Bodies stay in their object's own frame; the placement becomes the pose. Rooms get the
heights of their storey (`semap.formats.storey_band`). Doors join the rooms that the file's space boundaries
name; where it names none, the rooms are found from the shapes (`semap.formats.adjacency`).
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, UUID, uuid5

import numpy as np
import shapely
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.formats.adjacency import Floor, joined_rooms
from semap.formats.ifc_door import door_attributes
from semap.formats.source import read_ends, refuse_utf16
from semap.formats.storey_band import band_by_storey
from semap.formats.unique_name import unique_names
from semap.geometry.outline import outline
from semap.geometry.pose import pose_from_matrix, transform_points
from semap.model.building import Building, Finding, HeightBand, Item, Mesh, Storey
from semap.model.pose import IDENTITY, Pose

Entity = Any
"""An entity, or a whole file: IfcOpenShell makes their classes at run time."""

Progress = Callable[[int, int], None]
"""Called with the number of entities done and their total."""

CONCEPTS = {
    "IfcSpace": "Room",
    "IfcDoor": "Door",
    "IfcWindow": "Window",
    "IfcFurnishingElement": "Furniture",
}
"""What entities of a class, or of a class below it, become."""

DEPTH = 32
"""No sound model nests its spaces deeper; a model whose parts contain each other would never end."""


@dataclass(frozen=True, eq=False)
class _Placed:
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


def read_ifc(path: Path, progress: Progress | None = None) -> Building:
    """Read storeys, rooms, doors, windows and furniture of a building model.

    raises  NotFound if there is no such file; InvalidInput if it is not IFC, is cut off or has no spaces,
            or if IfcOpenShell is not installed
    """
    file = _open(path)
    if not file.by_type("IfcSpace"):
        raise InvalidInput(
            "the model has no spaces", "Export it with spaces (rooms), that is with IfcSpace.", str(path)
        )
    findings: list[Finding] = []
    storeys = _storeys(file, findings)
    placed = _place(file, storeys, findings, progress)
    joins = _joins(placed, findings)
    uids = _uids([each.entity for each in placed], findings)
    elevations_m = [storey.elevation_m for storey in storeys.values()]
    scales = {unit: _unit_scale(file, unit) for unit in ("LENGTHUNIT", "AREAUNIT")}
    items = tuple(
        Item(
            uid=uid,
            name=each.name,
            concept=each.concept,
            alias=getattr(each.entity, "LongName", None) or None,
            storey=None if each.storey is None else each.storey.name,
            pose=each.pose,
            body=each.body,
            band=_band(each, elevations_m),
            joins=joins.get(each.name, ()),
            attributes=_attributes(each, scales),
        )
        for each, uid in zip(placed, uids, strict=True)
    )
    return Building(tuple(storeys.values()), items, tuple(findings))


def _library(name: str = "ifcopenshell") -> Any:
    # It is large, and most installations never read IFC: it is an extra, imported when it is needed.
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidInput(
            "IFC files need IfcOpenShell, which is not installed", "Install it: pip install semap[ifc]"
        ) from error


def _open(path: Path) -> Entity:
    head, tail = read_ends(path, 1024)
    refuse_utf16(head, str(path))
    if b"ISO-10303-21" not in head:
        raise InvalidInput(
            "not an IFC file", "Export the model as IFC in the STEP format (.ifc, not zipped).", str(path)
        )
    # IfcOpenShell reads a truncated file without complaint, and rooms would silently be missing.
    if b"END-ISO-10303-21" not in tail:
        raise InvalidInput("the file is cut off", "Copy or export it again.", str(path))
    ifcopenshell = _library()
    try:
        return ifcopenshell.open(str(path))
    except (ifcopenshell.Error, RuntimeError, OSError) as error:
        raise InvalidInput(
            f"the model cannot be parsed: {error}", "Export it again, as IFC2X3 or IFC4.", str(path)
        ) from error


def _unit_scale(file: Entity, unit: str) -> float:
    """What one unit of the file is in SI units."""
    return float(_library("ifcopenshell.util.unit").calculate_unit_scale(file, unit))


def _storeys(file: Entity, findings: list[Finding]) -> dict[int, Storey]:
    """Storeys by the number of their entity."""
    entities = file.by_type("IfcBuildingStorey")
    wanted = [(entity.Name or entity.LongName or f"Storey {entity.GlobalId}", None) for entity in entities]
    names, renamed = unique_names(wanted)
    findings.extend(renamed)
    scale = _unit_scale(file, "LENGTHUNIT")
    uids = _uids(entities, findings)
    return {
        entity.id(): Storey(uid, name, _elevation(entity) * scale)
        for entity, name, uid in zip(entities, names, uids, strict=True)
    }


def _elevation(storey: Entity) -> float:
    """Height of a storey in the map frame, in units of the file.

    IfcBuildingStorey.Elevation counts from the building's own zero, while bodies are placed in the world.
    """
    placement = _library("ifcopenshell.util.placement").get_local_placement
    if storey.Elevation is None:
        return float(placement(storey.ObjectPlacement)[2, 3])
    parents = (storey.Decomposes[0].RelatingObject,) if storey.Decomposes else ()
    building_z = (placement(parent.ObjectPlacement)[2, 3] for parent in parents)
    return float(storey.Elevation + sum(building_z))


def _place(
    file: Entity, storeys: Mapping[int, Storey], findings: list[Finding], progress: Progress | None
) -> list[_Placed]:
    geom = _library("ifcopenshell.geom")
    settings = geom.settings()
    entities = [(entity, concept) for cls, concept in CONCEPTS.items() for entity in file.by_type(cls)]
    on = [_storey_of(entity, storeys) for entity, _ in entities]
    wanted = [
        (_wanted_name(entity), None if storey is None else storey.name)
        for (entity, _), storey in zip(entities, on, strict=True)
    ]
    names, renamed = unique_names(wanted, [storey.name for storey in storeys.values()])
    findings.extend(renamed)
    placed: list[_Placed] = []
    for (entity, concept), storey, name in zip(entities, on, names, strict=True):
        pose, body = IDENTITY, None
        try:
            pose, body = _shape(geom.create_shape(settings, entity))
        except (RuntimeError, InvalidInput) as error:
            reason = str(error).strip() or "its geometry cannot be made"
            findings.append(Finding("note", name, f"kept without body and pose: {reason}"))
        placed.append(_Placed(entity, concept, name, storey, pose, body))
        if progress is not None:
            progress(len(placed), len(entities))
    return placed


def _wanted_name(entity: Entity) -> str:
    return (entity.Name or getattr(entity, "LongName", None) or f"{entity.is_a()} {entity.GlobalId}").strip()


def _shape(shape: Any) -> tuple[Pose, Mesh]:
    """Pose and body of a tessellated entity; IfcOpenShell gives both in metres."""
    vertices_m = np.array(shape.geometry.verts, dtype=np.float64).reshape(-1, 3)
    faces = np.array(shape.geometry.faces, dtype=np.int64).reshape(-1, 3)
    if len(faces) == 0 or not np.isfinite(vertices_m).all():
        raise InvalidInput("its geometry has no surface")
    map_T_entity = np.array(shape.transformation.matrix, dtype=np.float64).reshape(4, 4).T
    return pose_from_matrix(map_T_entity), Mesh(vertices_m, faces)


def _storey_of(entity: Entity, storeys: Mapping[int, Storey]) -> Storey | None:
    """The storey that contains an entity, directly or through what it is part of."""
    element = _library("ifcopenshell.util.element")
    for _ in range(DEPTH):
        if entity is None or entity.id() in storeys:
            break
        entity = element.get_aggregate(entity) or element.get_container(entity, should_get_direct=True)
    return None if entity is None else storeys.get(entity.id())


def _band(placed: _Placed, elevations_m: Sequence[float]) -> HeightBand | None:
    """Rooms follow their storey; a door's heights are those of its body."""
    if placed.body is None or placed.concept != "Room":
        return None
    heights_m = placed.points_m()[:, 2]
    elevation_m = None if placed.storey is None else placed.storey.elevation_m
    return band_by_storey(float(heights_m.min()), float(heights_m.max()), elevation_m, elevations_m)


def _joins(placed: Sequence[_Placed], findings: list[Finding]) -> dict[str, tuple[str, ...]]:
    """The rooms on both sides of each door, by the door's name."""
    rooms = {each.entity.id(): each for each in placed if each.concept == "Room"}
    doors = [each for each in placed if each.concept == "Door"]
    joins: dict[str, tuple[str, ...]] = {}
    unbounded: list[_Placed] = []
    for door in doors:
        bounded = sorted({rooms[space].name for space in _bounded_spaces(door.entity) if space in rooms})
        joins[door.name] = tuple(bounded)
        if not bounded:
            unbounded.append(door)
    return joins | _joins_by_shape(unbounded, list(rooms.values()), findings)


def _bounded_spaces(door: Entity) -> set[int]:
    """Spaces that share a boundary (IfcRelSpaceBoundary, any level) with a door or with its opening."""
    openings = [fills.RelatingOpeningElement for fills in door.FillsVoids]
    return {
        boundary.RelatingSpace.id()
        for element in (door, *openings)
        for boundary in element.ProvidesBoundaries
        if boundary.RelatingSpace is not None
    }


def _joins_by_shape(
    doors: Sequence[_Placed], rooms: Sequence[_Placed], findings: list[Finding]
) -> dict[str, tuple[str, ...]]:
    if not doors:
        return {}
    footprints: dict[Storey | None, dict[str, shapely.Polygon | shapely.MultiPolygon]] = {}
    for room in rooms:
        try:
            footprint = None if room.body is None else outline(Mesh(room.points_m(), room.body.faces))
        except InvalidInput as error:
            findings.append(Finding("note", room.name, f"its doors cannot be found: {error}"))
            continue
        if footprint is not None:
            footprints.setdefault(room.storey, {})[room.name] = footprint
    findings.append(
        Finding("note", f"{len(doors)} doors", "the file does not say which rooms they join; found by shape")
    )
    floors = {storey: Floor(on_storey) for storey, on_storey in footprints.items()}
    nothing = Floor({})
    return {
        door.name: joined_rooms(
            shapely.MultiPoint(door.points_m()[:, :2]).convex_hull, floors.get(door.storey, nothing)
        )
        for door in doors
        if door.body is not None
    }


def _attributes(placed: _Placed, scales: Mapping[str, float]) -> dict[str, object]:
    """The entity's identity in the file, its measures where it has them [m, m2], and how a door opens."""
    entity = placed.entity
    attributes: dict[str, object] = {"ifc_global_id": entity.GlobalId, "ifc_class": entity.is_a()}
    kind = _library("ifcopenshell.util.element").get_type(entity)
    if (named := getattr(kind, "Name", None) or entity.ObjectType) is not None:
        attributes["ifc_type"] = named
    for attribute, key in (("OverallWidth", "width_m"), ("OverallHeight", "height_m")):
        if (value := getattr(entity, attribute, None)) is not None:
            attributes[key] = value * scales["LENGTHUNIT"]
    quantities = _library("ifcopenshell.util.element").get_psets(entity, qtos_only=True)
    for names in quantities.values():
        for name, key, unit in (
            ("NetFloorArea", "net_floor_area_m2", "AREAUNIT"),
            ("Height", "height_m", "LENGTHUNIT"),
        ):
            if isinstance(value := names.get(name), float):
                attributes[key] = value * scales[unit]
    if placed.concept == "Door":
        width = attributes.get("width_m")
        width_m = width if isinstance(width, float) and width > 0 else None
        attributes |= door_attributes(entity, kind, placed.body, width_m)
    return attributes


def _uids(entities: Sequence[Entity], findings: list[Finding]) -> tuple[UUID, ...]:
    """Each entity's GlobalId as a UUID, or, where it is malformed or repeated, one made from its place."""
    guid = _library("ifcopenshell.guid")
    uids: dict[UUID, None] = {}
    for entity in entities:
        try:
            uid = UUID(guid.expand(entity.GlobalId))
        except (ValueError, TypeError, _library().Error):
            uid = None
        if uid is None or uid in uids:
            findings.append(
                Finding(
                    "repaired", f"{entity.is_a()} #{entity.id()}", "its GlobalId is malformed or repeated"
                )
            )
            uid = uuid5(NAMESPACE_URL, f"ifc {entity.GlobalId} {entity.id()}")
        uids[uid] = None
    return tuple(uids)
