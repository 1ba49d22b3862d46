"""A whole map out of the database, without loss; `semap.store.exchange.map_import` brings it in again.

Names stand for ids. What is derived (absolute abstractions, regions, relations) is not exported: it follows.
Tracks, relations and events are what happened on a map and not part of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import shapely
from shapely import MultiPolygon, Polygon
from sqlalchemy import Connection, func, select, text

from semap.geometry.pose import pose_from_matrix
from semap.model.building import HeightBand
from semap.model.continuous_query import options_of
from semap.model.map_document import (
    ConceptEntry,
    DescriptionEntry,
    FrameEntry,
    InstanceEntry,
    MapDocument,
    PlacedInstance,
    QueryEntry,
    RuleEntry,
    StampedPose,
)
from semap.model.pose import Pose
from semap.store.database.connection import translated
from semap.store.database.tables import (
    abstraction,
    concept,
    description,
    door_room,
    frame,
    frame_pose,
    instance,
    rule,
)
from semap.store.map.anchor import read_anchor
from semap.store.map.concept import ROOT, list_concepts
from semap.store.map.description import read_geometries
from semap.store.map.grids import read_grids
from semap.store.map.maps import get_map, map_id_of
from semap.store.map.placement import PARTS, map_from_frames
from semap.store.relation.queries import list_queries

OWN = "instance {}"
"""Names the description that belongs to one instance alone."""


def export_map(connection: Connection, name: str) -> MapDocument:
    """All that is on a map, in an order that does not depend on ids.

    raises  NotFound
    """
    known = get_map(connection, name)
    descriptions, keys = _descriptions(connection, known.map_id)
    instances = _instances(connection, known.map_id, keys)
    return MapDocument(
        name=name,
        cell_m=known.cell_m,
        anchor=read_anchor(connection, name),
        concepts=_concepts(connection),
        frames=_frames(connection, known.map_id),
        descriptions=descriptions,
        instances=instances,
        queries=_queries(connection, known.name),
        rules=_rules(connection, known.map_id),
        grids=read_grids(connection, name),
    )


def placed_instances(connection: Connection, name: str) -> tuple[PlacedInstance, ...]:
    """Every instance of a map with where it stands now, by name.

    raises  NotFound
    """
    map_id = map_id_of(connection, name)
    _, keys = _descriptions(connection, map_id)
    entries = {each.name: each for each in _instances(connection, map_id, keys)}
    with translated():
        rows = connection.execute(
            select(
                instance.c.name,
                instance.c.frame_id,
                instance.c.relative_description_id,
                func.public.st_asbinary(abstraction.c.geometry, type_=None),
                abstraction.c.z_min_m,
                abstraction.c.z_max_m,
            )
            .outerjoin(
                abstraction,
                (abstraction.c.description_id == instance.c.absolute_description_id)
                & (abstraction.c.type == "Footprint"),
            )
            .where(instance.c.map_id == map_id)
            .order_by(instance.c.name)
        ).all()
    matrices = map_from_frames(connection, [row.frame_id for row in rows])
    sources = read_geometries(connection, {row[2] for row in rows if row[2] is not None})
    return tuple(
        PlacedInstance(
            entries[row.name],
            pose_from_matrix(matrices[row.frame_id]),
            _area(row[3]),
            None if row.z_min_m is None else HeightBand(row.z_min_m, row.z_max_m),
            sources.get(row[2], ()),
        )
        for row in rows
    )


def _area(wkb: Any) -> Polygon | MultiPolygon | None:
    shape = None if wkb is None else shapely.from_wkb(bytes(wkb))
    return shape if isinstance(shape, Polygon | MultiPolygon) else None


def _concepts(connection: Connection) -> tuple[ConceptEntry, ...]:
    return tuple(
        ConceptEntry(each.name, each.parents, each.iris, each.comment, each.attribute_schema)
        for each in list_concepts(connection)
        if each.name != ROOT
    )


def _frames(connection: Connection, map_id: int) -> tuple[FrameEntry, ...]:
    parent = frame.alias("parent")
    with translated():
        rows = connection.execute(
            select(frame.c.frame_id, frame.c.name, parent.c.name)
            .outerjoin(parent, parent.c.frame_id == frame.c.parent_id)
            .where(frame.c.map_id == map_id)
            .order_by(frame.c.name)
        ).all()
        poses: dict[int, list[StampedPose]] = {}
        for frame_id, stamp, *pose in connection.execute(
            select(
                frame_pose.c.frame_id,
                func.nullif(frame_pose.c.stamp, text("'-infinity'::timestamptz")),
                *(frame_pose.c[part] for part in PARTS),
            )
            .join(frame, frame.c.frame_id == frame_pose.c.frame_id)
            .where(frame.c.map_id == map_id)
            .order_by(frame_pose.c.frame_id, frame_pose.c.stamp)
        ):
            poses.setdefault(frame_id, []).append(StampedPose(Pose(*pose), stamp))
    return tuple(FrameEntry(name, above, tuple(poses.get(frame_id, ()))) for frame_id, name, above in rows)


def _descriptions(connection: Connection, map_id: int) -> tuple[tuple[DescriptionEntry, ...], dict[int, str]]:
    """Blueprints, and what belongs to one instance, keyed by that instance's name; and all keys by id."""
    with translated():
        rows = connection.execute(
            select(description.c.description_id, description.c.name, func.min(instance.c.name))
            .outerjoin(instance, instance.c.relative_description_id == description.c.description_id)
            .where(description.c.map_id == map_id, ~description.c.is_absolute)
            .group_by(description.c.description_id)
        ).all()
    kept = [row for row in rows if row[1] is not None or row[2] is not None]
    keys = {id_: OWN.format(user) if name is None else name for id_, name, user in kept}
    sources = read_geometries(connection, keys)
    entries = [
        DescriptionEntry(
            keys[id_],
            tuple(sorted(sources.get(id_, ()), key=lambda each: each.name)),
            is_shared=name is not None,
        )
        for id_, name, _ in kept
    ]
    return tuple(sorted(entries, key=lambda each: (not each.is_shared, each.key))), keys


def _instances(connection: Connection, map_id: int, keys: Mapping[int, str]) -> tuple[InstanceEntry, ...]:
    storey, room = instance.alias("storey"), instance.alias("room")
    with translated():
        joins: dict[int, list[str]] = {}
        for door_id, name in connection.execute(
            select(door_room.c.door_id, room.c.name)
            .join(room, room.c.instance_id == door_room.c.room_id)
            .where(room.c.map_id == map_id)
            .order_by(room.c.name)
        ):
            joins.setdefault(door_id, []).append(name)
        rows = connection.execute(
            select(
                instance.c.instance_id,
                instance.c.uid,
                instance.c.name,
                concept.c.name,
                frame.c.name,
                instance.c.alias,
                instance.c.relative_description_id,
                storey.c.name,
                instance.c.attributes,
            )
            .join(concept, concept.c.concept_id == instance.c.concept_id)
            .join(frame, frame.c.frame_id == instance.c.frame_id)
            .outerjoin(storey, storey.c.instance_id == instance.c.storey_id)
            .where(instance.c.map_id == map_id)
            .order_by(instance.c.name)
        ).all()
    return tuple(
        InstanceEntry(
            uid,
            name,
            kind,
            frame_name,
            alias,
            keys.get(described),
            above,
            tuple(joins.get(id_, ())),
            attributes,
        )
        for id_, uid, name, kind, frame_name, alias, described, above, attributes in rows
    )


def _queries(connection: Connection, map_name: str) -> tuple[QueryEntry, ...]:
    found: list[QueryEntry] = []
    last_id = 0
    while page := list_queries(connection, map_name=map_name, after=last_id):
        last_id = page[-1].query_id
        for each in page:
            asked = each.declaration
            found.append(
                QueryEntry(asked.name, asked.predicate, asked.object.concept, each.enabled, options_of(asked))
            )
    return tuple(sorted(found, key=lambda entry: entry.name))


def _rules(connection: Connection, map_id: int) -> tuple[RuleEntry, ...]:
    with translated():
        rows = connection.execute(
            select(rule.c.name, rule.c.queries, rule.c.declaration, rule.c.enabled)
            .where(rule.c.map_id == map_id)
            .order_by(rule.c.name)
        )
        return tuple(RuleEntry(name, tuple(sorted(queries)), *rest) for name, queries, *rest in rows)
