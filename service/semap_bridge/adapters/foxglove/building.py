"""What stands on a map, as entities of a scene: rooms, doors, furniture."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from foxglove.messages import (
    Color,
    CubePrimitive,
    KeyValuePair,
    LinePrimitive,
    LinePrimitiveLineType,
    Point3,
    Pose,
    Quaternion,
    SceneEntity,
    TextPrimitive,
    TriangleListPrimitive,
    Vector3,
)
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.formats.gltf import COLOURS, OTHER_COLOUR, shown_surface
from semap.geometry.pose import transform_points
from semap.geometry.triangulation import triangles
from semap.model.building import Mesh
from semap.model.map_document import PlacedInstance
from semap.model.plan import Kind
from semap.model.source_geometry import SourceGeometry
from semap.store.exchange.map_export import placed_instances
from semap.store.map.frames import Frame, list_frames
from semap.store.map.placement import ROOT_FRAME
from semap.store.motion.plan import things
from semap_bridge.adapters.foxglove.channels import timestamp

DOOR_COLOURS: Mapping[str, tuple[float, float, float, float]] = {
    "open": (0.2, 0.7, 0.3, 0.9),
    "opening": (0.95, 0.7, 0.1, 0.9),
    "closing": (0.95, 0.7, 0.1, 0.9),
    "closed": (0.75, 0.2, 0.2, 0.9),
}
UNKNOWN_COLOUR = (0.5, 0.5, 0.5, 0.6)
OUTLINE_COLOUR = (0.25, 0.35, 0.45, 1.0)
TEXT_COLOUR = Color(r=0.1, g=0.1, b=0.1, a=1.0)
DOOR_M = (0.06, 2.0)
"""Thickness, and height where the map has none."""
FRAMES = 1000


@dataclass(frozen=True, eq=False)
class Door:
    """A door: its middle at its foot, and its size; x is along it."""

    name: str
    pose: Pose
    size: Vector3


@dataclass(frozen=True, eq=False)
class Building:
    """What stands on a map.

    change_set  the map's newest change that is in it
    entities    rooms and furniture by id, as bytes too, by which changes are known
    doors       by the ids of instances
    rooms       names of rooms, by the ids of instances
    """

    change_set: int
    frames: tuple[Frame, ...]
    entities: Mapping[str, SceneEntity]
    encoded: Mapping[str, bytes]
    doors: Mapping[int, Door]
    rooms: Mapping[int, str]


def read_building(connection: Connection, map_name: str, change_set: int) -> Building:
    """raises NotFound where there is no such map"""
    kinds = {each.name: each for each in things(connection, map_name)}
    entities: dict[str, SceneEntity] = {}
    doors: dict[int, Door] = {}
    for placed in placed_instances(connection, map_name):
        thing = kinds.get(placed.entry.name)
        if thing is None:
            continue
        if thing.kind == Kind.DOOR:
            doors[thing.instance_id] = _door(placed, thing.shape)
            continue
        entity_id = str(placed.entry.uid)
        made = _room(placed, entity_id) if thing.kind == Kind.ROOM else _furniture(placed, entity_id)
        if made is not None:
            entities[entity_id] = made
    return Building(
        change_set,
        _frames(connection, map_name),
        entities,
        {entity_id: each.encode() for entity_id, each in entities.items()},
        doors,
        {each.instance_id: each.name for each in kinds.values() if each.kind == Kind.ROOM},
    )


def door_id_of(instance_id: int) -> str:
    """The id of its entity."""
    return f"door/{instance_id}"


def door_entity(instance_id: int, door: Door, state: str, stamp_us: int) -> SceneEntity:
    """A door in the colour of how it stands."""
    colour = _colour(DOOR_COLOURS.get(state, UNKNOWN_COLOUR))
    return SceneEntity(
        timestamp=timestamp(stamp_us),
        frame_id=ROOT_FRAME,
        id=door_id_of(instance_id),
        metadata=[KeyValuePair(key="name", value=door.name), KeyValuePair(key="state", value=state)],
        cubes=[CubePrimitive(pose=door.pose, size=door.size, color=colour)],
    )


def text(words: str, x_m: float, y_m: float, z_m: float, size_m: float) -> TextPrimitive:
    """Words that face whoever looks."""
    return TextPrimitive(
        pose=pose_at(x_m, y_m, z_m),
        billboard=True,
        font_size=size_m,
        color=TEXT_COLOUR,
        text=words,
    )


def pose_at(x_m: float, y_m: float, z_m: float, yaw_rad: float = 0.0) -> Pose:
    return Pose(
        position=Vector3(x=x_m, y=y_m, z=z_m),
        orientation=Quaternion(z=math.sin(yaw_rad / 2), w=math.cos(yaw_rad / 2)),
    )


def _room(placed: PlacedInstance, entity_id: str) -> SceneEntity | None:
    """Its floor, see-through, its outline at floor and ceiling, and its name."""
    area = placed.footprint
    if area is None or area.is_empty:
        return None
    band = placed.band
    low_m = placed.pose.z_m if band is None else band.z_min_m
    heights_m = [low_m] if band is None else [low_m, band.z_max_m]
    middle = shapely.point_on_surface(area)
    parts = area.geoms if isinstance(area, MultiPolygon) else [area]
    surfaces = [surface for part in parts if (surface := _flat(part, low_m)) is not None]
    return _entity(
        placed,
        entity_id,
        surfaces,
        COLOURS["Room"],
        lines=[
            LinePrimitive(
                type=LinePrimitiveLineType.LineStrip,
                pose=pose_at(0, 0, 0),
                thickness=2.0,
                scale_invariant=True,
                points=[Point3(x=x_m, y=y_m, z=z_m) for x_m, y_m in shapely.get_coordinates(ring).tolist()],
                color=_colour(OUTLINE_COLOUR),
            )
            for part in parts
            for ring in (part.exterior, *part.interiors)
            for z_m in heights_m
        ],
        texts=[text(placed.entry.alias or placed.entry.name, middle.x, middle.y, low_m + 0.1, 0.3)],
    )


def _furniture(placed: PlacedInstance, entity_id: str) -> SceneEntity | None:
    mesh = shown_surface(placed)
    if mesh is None:
        return None
    on_map = Mesh(transform_points(placed.pose.matrix(), mesh.vertices_m), mesh.faces)
    return _entity(placed, entity_id, [on_map], COLOURS.get(placed.entry.concept, OTHER_COLOUR))


def _entity(
    placed: PlacedInstance,
    entity_id: str,
    surfaces: Sequence[Mesh],
    colour: tuple[float, float, float, float],
    lines: Sequence[LinePrimitive] = (),
    texts: Sequence[TextPrimitive] = (),
) -> SceneEntity:
    said = {"name": placed.entry.name, "concept": placed.entry.concept}
    said |= {key: str(value) for key, value in placed.entry.attributes.items()}
    return SceneEntity(
        timestamp=timestamp(0),
        frame_id=ROOT_FRAME,
        id=entity_id,
        metadata=[KeyValuePair(key=key, value=value) for key, value in said.items()],
        triangles=[
            TriangleListPrimitive(
                pose=pose_at(0, 0, 0),
                points=[Point3(x=x_m, y=y_m, z=z_m) for x_m, y_m, z_m in each.vertices_m.tolist()],
                color=_colour(colour),
                indices=each.faces.reshape(-1).tolist(),
            )
            for each in surfaces
        ],
        lines=list(lines),
        texts=list(texts),
    )


def _flat(part: Polygon, z_m: float) -> Mesh | None:
    """An area at a height; None for one that cannot be triangulated, which is not shown."""
    try:
        return triangles(SourceGeometry("floor", "POLYGON3D", shapely.force_3d(part, z_m)))
    except InvalidInput:
        return None


def _door(placed: PlacedInstance, shape: shapely.Geometry) -> Door:
    """Where its line is, or the longer axis of its outline."""
    ends, across_m = _axis(shape)
    low_m = placed.pose.z_m if placed.band is None else placed.band.z_min_m
    height_m = DOOR_M[1] if placed.band is None else placed.band.z_max_m - low_m
    (x_m, y_m), along = ends.mean(axis=0).tolist(), ends[1] - ends[0]
    return Door(
        placed.entry.name,
        pose_at(x_m, y_m, low_m + height_m / 2, float(np.arctan2(along[1], along[0]))),
        Vector3(x=float(np.hypot(*along)), y=max(across_m, DOOR_M[0]), z=height_m),
    )


def _axis(shape: shapely.Geometry) -> tuple[NDArray[np.float64], float]:
    """Two ends (2, 2) [m], and how wide it is across [m]."""
    around = shape if shape.geom_type == "LineString" else shapely.minimum_rotated_rectangle(shape)
    corners = shapely.get_coordinates(around)
    if len(corners) < 4:
        return np.array([corners[0], corners[-1]]), 0.0
    sides = np.hypot(*(corners[1:3] - corners[:2]).T)
    first, second = (corners[0:2], corners[2:4]) if sides[0] < sides[1] else (corners[1:3], corners[[0, 3]])
    return np.array([first.mean(axis=0), second.mean(axis=0)]), float(sides.min())


def _frames(connection: Connection, map_name: str) -> tuple[Frame, ...]:
    found: list[Frame] = []
    while page := list_frames(connection, map_name, after=found[-1].frame_id if found else 0, limit=FRAMES):
        found += page
    return tuple(found)


def _colour(rgba: tuple[float, float, float, float]) -> Color:
    red, green, blue, alpha = rgba
    return Color(r=red, g=green, b=blue, a=alpha)
