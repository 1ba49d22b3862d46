"""Ways of an IFC model that are no doors, as items of the building.

Stairs, ramps and lifts, openings of walls that nothing fills, and virtual boundaries, where two spaces meet
without a wall.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from uuid import NAMESPACE_URL, UUID, uuid5

import numpy as np
from numpy.typing import NDArray

from semap.formats.adjacency import Floor
from semap.formats.ifc_boundary import meetings, virtual_boundaries
from semap.formats.ifc_model import (
    Entity,
    Footprint,
    Placed,
    band_of,
    floors_of,
    made_uid,
    placement,
    storey_of,
    uid_of,
    unit_scale,
    whole_shape,
)
from semap.formats.ifc_passage import (
    LIFT,
    Place,
    joined_by_lift,
    joined_by_opening,
    joined_by_stair,
    parts_of,
    passage_entities,
)
from semap.formats.unique_name import unique_names
from semap.geometry.pose import pose_from_yaw, transform_points
from semap.model.building import Finding, Item, Mesh, Storey
from semap.model.pose import Pose


def ways_of(
    file: Entity,
    placed: Sequence[Placed],
    storeys: Mapping[int, Storey],
    footprints: Mapping[str, Footprint],
    uids: set[UUID],
    findings: list[Finding],
) -> tuple[Item, ...]:
    """Stairs, ramps, lifts and openings that are no doors, each with the rooms that it joins.

    placed      rooms, doors and the like, whose names are taken
    uids        those that are taken
    footprints  outlines of rooms by name [m, map frame]
    findings    gets what was left out and why
    """
    floors = floors_of(placed, footprints)
    found = [
        *_passages(file, placed, storeys, footprints, findings),
        *_unfilled(file, storeys, floors, findings),
        *_meetings(file, placed, findings),
    ]
    taken = [*(each.name for each in placed), *(storey.name for storey in storeys.values())]
    names, _ = unique_names([(item.name, item.storey) for item in found], taken)
    ways: list[Item] = []
    for item, name in zip(found, names, strict=True):
        uid = item.uid if item.uid not in uids else uuid5(NAMESPACE_URL, f"ifc way {name}")
        uids.add(uid)
        ways.append(replace(item, name=name, uid=uid))
    return tuple(ways)


def _passages(
    file: Entity,
    placed: Sequence[Placed],
    storeys: Mapping[int, Storey],
    footprints: Mapping[str, Footprint],
    findings: list[Finding],
) -> Iterator[Item]:
    elevations_m = [storey.elevation_m for storey in storeys.values()]
    places = [
        Place(each.name, footprints[each.name], band, None if each.storey is None else each.storey.name)
        for each in placed
        if each.name in footprints and (band := band_of(each, elevations_m)) is not None
    ]
    for entity, concept in passage_entities(file):
        name = (entity.Name or f"{concept} {entity.GlobalId}").strip()
        pose, body = whole_shape(parts_of(entity))
        joins: tuple[str, ...] = ()
        if body is None:
            findings.append(Finding("note", name, "kept without body and pose: it has no geometry"))
        else:
            joined = joined_by_lift if concept == LIFT else joined_by_stair
            joins = joined(_corners_m(pose, body), places)
            if len(joins) < 2:
                findings.append(Finding("note", name, "it joins no two rooms: none is found at its ends"))
        yield _item(entity, name, concept, storey_of(entity, storeys), pose, body, joins)


def _unfilled(
    file: Entity,
    storeys: Mapping[int, Storey],
    floors: Mapping[Storey | None, Floor],
    findings: list[Finding],
) -> Iterator[Item]:
    """Holes in walls that no door and no window fills, as far as they lead from room to room."""
    passed_over = 0
    for entity in file.by_type("IfcOpeningElement"):
        walls = [voids.RelatingBuildingElement for voids in entity.VoidsElements]
        if entity.HasFillings or not any(wall.is_a("IfcWall") for wall in walls):
            continue
        storey = storey_of(walls[0], storeys)
        pose, body = whole_shape([entity])
        joins: tuple[str, ...] = ()
        if body is not None and storey in floors:
            elevation_m = None if storey is None else storey.elevation_m
            joins = joined_by_opening(_corners_m(pose, body), elevation_m, floors[storey])
        if joins:
            name = f"Opening {' - '.join(joins)}"
            yield _item(entity, name, "Opening", storey, pose, body, joins)
        else:
            passed_over += 1
    if passed_over:
        reason = "left out: they do not lead from one room into another, or are too narrow"
        findings.append(Finding("skipped", f"{passed_over} openings in walls without a door", reason))


def _meetings(file: Entity, placed: Sequence[Placed], findings: list[Finding]) -> Iterator[Item]:
    """Places where two rooms meet without a wall, by their virtual boundaries."""
    rooms = {each.entity.id(): each for each in placed if each.concept == "Room"}
    boundaries, unread = virtual_boundaries(file, unit_scale(file, "LENGTHUNIT"), placement)
    if unread:
        reason = "left out: they are drawn in a way that semap does not read"
        findings.append(Finding("skipped", f"{unread} virtual boundaries", reason))
    for meeting in meetings(boundaries):
        one, other = (rooms.get(space) for space in meeting.spaces)
        if one is None or other is None:
            continue
        joins = tuple(sorted((one.name, other.name)))
        ends_m = np.array(meeting.line.coords)
        along_m = ends_m[-1] - ends_m[0]
        x_m, y_m = (float(each) for each in ends_m.mean(axis=0))
        yield Item(
            uid=uuid5(NAMESPACE_URL, f"ifc meeting {sorted(meeting.spaces)} {x_m:.3f} {y_m:.3f}"),
            name=f"Opening {' - '.join(joins)}",
            concept="Opening",
            storey=one.storey.name if one.storey is not None and one.storey is other.storey else None,
            pose=pose_from_yaw(x_m, y_m, meeting.z_min_m, float(np.arctan2(along_m[1], along_m[0]))),
            joins=joins,
            attributes={
                "ifc_class": "IfcRelSpaceBoundary",
                "width_m": round(float(meeting.line.length), 6),
                "height_m": round(meeting.z_max_m - meeting.z_min_m, 6),
            },
        )


def _item(
    entity: Entity,
    name: str,
    concept: str,
    storey: Storey | None,
    pose: Pose,
    body: Mesh | None,
    joins: tuple[str, ...],
) -> Item:
    return Item(
        uid=uid_of(entity) or made_uid(entity),
        name=name,
        concept=concept,
        storey=None if storey is None else storey.name,
        pose=pose,
        body=body,
        joins=joins,
        attributes={"ifc_global_id": entity.GlobalId, "ifc_class": entity.is_a()},
    )


def _corners_m(pose: Pose, body: Mesh) -> NDArray[np.float64]:
    return transform_points(pose.matrix(), body.vertices_m)
