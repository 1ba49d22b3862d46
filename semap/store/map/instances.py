"""Instances: the things of a map, found and read.

What is shown is absolute: poses and outlines in the map frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any
from uuid import UUID

import shapely
from sqlalchemy import Connection, Select, func, select, text

from semap.errors import NotFound
from semap.geometry.pose import pose_from_matrix
from semap.model.building import HeightBand
from semap.model.pose import Pose
from semap.store.database.connection import translated
from semap.store.database.tables import (
    abstraction,
    concept,
    description,
    door_room,
    frame,
    geometry,
    instance,
    map_,
)
from semap.store.map.placement import map_from_frames

IS_PLACED = text("""
    select p.pose is not null from semap.frames_in_root(array[cast(:frame_id as bigint)]) p
    join semap.frame r on r.frame_id = p.root_id and r.name = 'map'
""")
ABOVE = instance.alias("storey")
PARENT = frame.alias("parent")
SOLID = abstraction.alias("solid")
BODIES = ("TRIANGLEMESH3D", "POLYGONMESH3D")


@dataclass(frozen=True)
class Instance:
    """An instance as lists show it; `storey` is the name of the storey that it is on."""

    instance_id: int
    uid: UUID
    map: str
    name: str
    alias: str | None
    concept: str
    storey: str | None


@dataclass(frozen=True, eq=False)
class InstanceDetail:
    """All that is known of an instance.

    pose       map_T_instance; None: its frame hangs under another root than `map`, or was nowhere yet
    footprint  in the map frame [m]; None where there is none
    band       heights that it answers for, such as those of its storey; None: every height
    body_band  heights that its body has itself; None where it has none
    joins      for a door the rooms on both sides, for a room its doors: names by id

    frame, parent  its own frame, and the one that carries it; a root has none
    description    the name of its blueprint; None: its description is its own, or it has none
    """

    instance: Instance
    pose: Pose | None
    footprint: shapely.Geometry | None
    band: HeightBand | None
    body_band: HeightBand | None
    joins: Mapping[int, str]
    has_body: bool
    attributes: Mapping[str, object]
    created_at: datetime
    updated_at: datetime
    frame_id: int
    frame: str
    parent: str | None
    description_id: int | None
    description: str | None


def list_instances(
    connection: Connection,
    *,
    map_name: str | None = None,
    concept_name: str | None = None,
    name: str | None = None,
    after: int = 0,
    limit: int = 100,
) -> tuple[Instance, ...]:
    """At most `limit` instances in the order of their ids, from the first after `after`.

    concept_name  this concept or any below it
    name          the whole name or alias, in any case
    """
    found = _INSTANCES.where(instance.c.instance_id > after).order_by(instance.c.instance_id).limit(limit)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    if concept_name is not None:
        below = func.semap.concepts_below(
            select(concept.c.concept_id).where(concept.c.name == concept_name).scalar_subquery()
        )
        found = found.where(instance.c.concept_id.in_(select(below.column_valued("concept_id"))))
    if name is not None:
        wanted = func.lower(name)
        found = found.where(
            (func.lower(instance.c.name) == wanted) | (func.lower(instance.c.alias) == wanted)
        )
    with translated():
        return tuple(Instance(*row) for row in connection.execute(found))


def get_instance(connection: Connection, instance_id: int) -> InstanceDetail:
    """raises NotFound"""
    with translated():
        row = connection.execute(_DETAILS.where(instance.c.instance_id == instance_id)).one_or_none()
    if row is None:
        raise NotFound("instance", instance_id, "List the instances to see their ids.")
    wkb, low_m, high_m, body_low_m, body_high_m, has_body, *rest = row[7:]
    attributes, created_at, updated_at, frame_id, *links = rest
    return InstanceDetail(
        instance=Instance(*row[:7]),
        pose=_pose_in_map(connection, frame_id),
        footprint=None if wkb is None else shapely.from_wkb(bytes(wkb)),
        band=_band(low_m, high_m),
        body_band=_band(body_low_m, body_high_m),
        joins=_joins(connection, instance_id),
        has_body=has_body,
        attributes=attributes,
        created_at=created_at,
        updated_at=updated_at,
        frame_id=frame_id,
        frame=links[0],
        parent=links[1],
        description_id=links[2],
        description=links[3],
    )


def _band(z_min_m: float | None, z_max_m: float | None) -> HeightBand | None:
    return None if z_min_m is None or z_max_m is None else HeightBand(z_min_m, z_max_m)


def _pose_in_map(connection: Connection, frame_id: int) -> Pose | None:
    with translated():
        is_placed = connection.scalar(IS_PLACED, {"frame_id": frame_id})
    return pose_from_matrix(map_from_frames(connection, [frame_id])[frame_id]) if is_placed else None


def _joins(connection: Connection, instance_id: int) -> dict[int, str]:
    as_door = (
        select(instance.c.instance_id, instance.c.name)
        .join(door_room, door_room.c.room_id == instance.c.instance_id)
        .where(door_room.c.door_id == instance_id)
    )
    as_room = (
        select(instance.c.instance_id, instance.c.name)
        .join(door_room, door_room.c.door_id == instance.c.instance_id)
        .where(door_room.c.room_id == instance_id)
    )
    with translated():
        rows = connection.execute(as_door.union(as_room).order_by(text("name"))).all()
    return dict(rows)


_COLUMNS = (
    instance.c.instance_id,
    instance.c.uid,
    map_.c.name,
    instance.c.name,
    instance.c.alias,
    concept.c.name,
    ABOVE.c.name,
)


def _from_instances(*columns: Any) -> Select[Any]:
    return (
        select(*columns)
        .select_from(instance)
        .join(map_, map_.c.map_id == instance.c.map_id)
        .join(concept, concept.c.concept_id == instance.c.concept_id)
        .outerjoin(ABOVE, ABOVE.c.instance_id == instance.c.storey_id)
    )


_INSTANCES = _from_instances(*_COLUMNS)
_DETAILS = (
    _from_instances(
        *_COLUMNS,
        func.public.st_asbinary(abstraction.c.geometry, type_=None),
        abstraction.c.z_min_m,
        abstraction.c.z_max_m,
        SOLID.c.z_min_m,
        SOLID.c.z_max_m,
        select(geometry.c.geometry_id)
        .where(geometry.c.description_id == instance.c.relative_description_id, geometry.c.type.in_(BODIES))
        .exists(),
        instance.c.attributes,
        instance.c.created_at,
        instance.c.updated_at,
        instance.c.frame_id,
        frame.c.name,
        PARENT.c.name,
        instance.c.relative_description_id,
        description.c.name,
    )
    .join(frame, frame.c.frame_id == instance.c.frame_id)
    .outerjoin(PARENT, PARENT.c.frame_id == frame.c.parent_id)
    .outerjoin(description, description.c.description_id == instance.c.relative_description_id)
    .outerjoin(
        abstraction,
        (abstraction.c.description_id == instance.c.absolute_description_id)
        & (abstraction.c.type == "Footprint"),
    )
    .outerjoin(
        SOLID,
        (SOLID.c.description_id == instance.c.absolute_description_id) & (SOLID.c.type == "AxisAligned3D"),
    )
)
