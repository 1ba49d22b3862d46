"""Building models in IFC (ISO 16739; IFC2X3 and IFC4), read with IfcOpenShell.

IfcBuildingStorey becomes a storey, IfcSpace a Room, IfcDoor a Door, IfcWindow a Window, and whatever lies
below IfcFurnishingElement Furniture; attributes keep the entity's own class and type. All lengths are
converted to metres. Bodies stay in their object's own frame; the placement becomes the pose. Rooms get the
heights of their storey (`semap.formats.storey_band`), and their bodies keep their own. Doors join the rooms
that the file's space boundaries name; where it names none, the rooms are found from the shapes
(`semap.formats.adjacency`). So do stairs, ramps, lifts, openings without doors and virtual boundaries
(`semap.formats.ifc_ways`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from uuid import UUID

import shapely

from semap.errors import InvalidInput
from semap.formats.adjacency import joined_rooms
from semap.formats.ifc_door import door_attributes
from semap.formats.ifc_model import (
    Entity,
    Footprint,
    Placed,
    band_of,
    floors_of,
    footprints_of,
    library,
    made_uid,
    placement,
    shape_of,
    storey_of,
    uid_of,
    unit_scale,
)
from semap.formats.ifc_ways import ways_of
from semap.formats.source import read_ends, refuse_utf16
from semap.formats.unique_name import unique_names
from semap.model.building import Building, Finding, Item, Storey
from semap.model.pose import IDENTITY

Progress = Callable[[int, int], None]
"""Called with the number of entities done and their total."""

CONCEPTS = {
    "IfcSpace": "Room",
    "IfcDoor": "Door",
    "IfcWindow": "Window",
    "IfcFurnishingElement": "Furniture",
}
"""What entities of a class, or of a class below it, become."""


def read_ifc(path: Path, progress: Progress | None = None) -> Building:
    """Read storeys, rooms, doors, windows, furniture and ways of a building model.

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
    footprints = footprints_of(placed, findings)
    joins = _joins(placed, footprints, findings)
    uids = _uids([each.entity for each in placed], findings)
    elevations_m = [storey.elevation_m for storey in storeys.values()]
    scales = {unit: unit_scale(file, unit) for unit in ("LENGTHUNIT", "AREAUNIT")}
    items = tuple(
        Item(
            uid=uid,
            name=each.name,
            concept=each.concept,
            alias=getattr(each.entity, "LongName", None) or None,
            storey=None if each.storey is None else each.storey.name,
            pose=each.pose,
            body=each.body,
            band=band_of(each, elevations_m),
            joins=joins.get(each.name, ()),
            attributes=_attributes(each, scales),
        )
        for each, uid in zip(placed, uids, strict=True)
    )
    ways = ways_of(file, placed, storeys, footprints, set(uids), findings)
    return Building(tuple(storeys.values()), (*items, *ways), tuple(findings))


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
    ifcopenshell = library()
    try:
        return ifcopenshell.open(str(path))
    except (ifcopenshell.Error, RuntimeError, OSError) as error:
        raise InvalidInput(
            f"the model cannot be parsed: {error}", "Export it again, as IFC2X3 or IFC4.", str(path)
        ) from error


def _storeys(file: Entity, findings: list[Finding]) -> dict[int, Storey]:
    """Storeys by the number of their entity."""
    entities = file.by_type("IfcBuildingStorey")
    wanted = [(entity.Name or entity.LongName or f"Storey {entity.GlobalId}", None) for entity in entities]
    names, renamed = unique_names(wanted)
    findings.extend(renamed)
    scale = unit_scale(file, "LENGTHUNIT")
    uids = _uids(entities, findings)
    return {
        entity.id(): Storey(uid, name, _elevation(entity) * scale)
        for entity, name, uid in zip(entities, names, uids, strict=True)
    }


def _elevation(storey: Entity) -> float:
    """Height of a storey in the map frame, in units of the file.

    IfcBuildingStorey.Elevation counts from the building's own zero, while bodies are placed in the world.
    """
    if storey.Elevation is None:
        return float(placement(storey.ObjectPlacement)[2, 3])
    parents = (storey.Decomposes[0].RelatingObject,) if storey.Decomposes else ()
    building_z = (placement(parent.ObjectPlacement)[2, 3] for parent in parents)
    return float(storey.Elevation + sum(building_z))


def _place(
    file: Entity, storeys: Mapping[int, Storey], findings: list[Finding], progress: Progress | None
) -> list[Placed]:
    geom = library("ifcopenshell.geom")
    settings = geom.settings()
    entities = [(entity, concept) for cls, concept in CONCEPTS.items() for entity in file.by_type(cls)]
    on = [storey_of(entity, storeys) for entity, _ in entities]
    wanted = [
        (_wanted_name(entity), None if storey is None else storey.name)
        for (entity, _), storey in zip(entities, on, strict=True)
    ]
    names, renamed = unique_names(wanted, [storey.name for storey in storeys.values()])
    findings.extend(renamed)
    placed: list[Placed] = []
    for (entity, concept), storey, name in zip(entities, on, names, strict=True):
        pose, body = IDENTITY, None
        try:
            pose, body = shape_of(geom.create_shape(settings, entity))
        except (RuntimeError, InvalidInput) as error:
            reason = str(error).strip() or "its geometry cannot be made"
            findings.append(Finding("note", name, f"kept without body and pose: {reason}"))
        placed.append(Placed(entity, concept, name, storey, pose, body))
        if progress is not None:
            progress(len(placed), len(entities))
    return placed


def _wanted_name(entity: Entity) -> str:
    return (entity.Name or getattr(entity, "LongName", None) or f"{entity.is_a()} {entity.GlobalId}").strip()


def _joins(
    placed: Sequence[Placed], footprints: Mapping[str, Footprint], findings: list[Finding]
) -> dict[str, tuple[str, ...]]:
    """The rooms on both sides of each door, by the door's name."""
    rooms = {each.entity.id(): each for each in placed if each.concept == "Room"}
    doors = [each for each in placed if each.concept == "Door"]
    joins: dict[str, tuple[str, ...]] = {}
    unbounded: list[Placed] = []
    for door in doors:
        bounded = sorted({rooms[space].name for space in _bounded_spaces(door.entity) if space in rooms})
        joins[door.name] = tuple(bounded)
        if not bounded:
            unbounded.append(door)
    if not unbounded:
        return joins
    findings.append(
        Finding(
            "note",
            f"{len(unbounded)} doors",
            "the file does not say which rooms they join; found by shape",
        )
    )
    floors = floors_of(placed, footprints)
    return joins | {
        door.name: joined_rooms(shapely.MultiPoint(door.points_m()[:, :2]).convex_hull, floors[door.storey])
        for door in unbounded
        if door.body is not None
    }


def _bounded_spaces(door: Entity) -> set[int]:
    """Spaces that share a boundary (IfcRelSpaceBoundary, any level) with a door or with its opening."""
    openings = [fills.RelatingOpeningElement for fills in door.FillsVoids]
    return {
        boundary.RelatingSpace.id()
        for element in (door, *openings)
        for boundary in element.ProvidesBoundaries
        if boundary.RelatingSpace is not None
    }


def _attributes(placed: Placed, scales: Mapping[str, float]) -> dict[str, object]:
    """The entity's identity in the file, its measures where it has them [m, m2], and how a door opens."""
    entity = placed.entity
    attributes: dict[str, object] = {"ifc_global_id": entity.GlobalId, "ifc_class": entity.is_a()}
    kind = library("ifcopenshell.util.element").get_type(entity)
    if (named := getattr(kind, "Name", None) or entity.ObjectType) is not None:
        attributes["ifc_type"] = named
    for attribute, key in (("OverallWidth", "width_m"), ("OverallHeight", "height_m")):
        if (value := getattr(entity, attribute, None)) is not None:
            attributes[key] = value * scales["LENGTHUNIT"]
    quantities = library("ifcopenshell.util.element").get_psets(entity, qtos_only=True)
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
    uids: dict[UUID, None] = {}
    for entity in entities:
        uid = uid_of(entity)
        if uid is None or uid in uids:
            findings.append(
                Finding(
                    "repaired", f"{entity.is_a()} #{entity.id()}", "its GlobalId is malformed or repeated"
                )
            )
            uid = made_uid(entity)
        uids[uid] = None
    return tuple(uids)
