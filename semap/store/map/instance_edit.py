"""Instances: made, edited and deleted, in the caller's transaction.

What is derived from a pose or a body follows in the same transaction: whoever reads the map never sees
one without the other. A frame carries the frames below it: moving a storey moves its rooms.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Literal

from shapely import MultiPolygon, Polygon
from sqlalchemy import Connection, func, select, update

from semap.errors import Conflict, InvalidInput, NotFound
from semap.geometry.prism import extrude, is_prism
from semap.model.building import HeightBand, Item, Mesh
from semap.model.pose import IDENTITY, Pose
from semap.model.source_geometry import BODY, OUTLINE, SourceGeometry
from semap.store.database.connection import translated
from semap.store.database.tables import concept, frame, instance, one_of
from semap.store.map.building import describe, insert_items
from semap.store.map.concept import check_attributes, concept_id
from semap.store.map.description import (
    band_within,
    insert_descriptions,
    outline_of,
    own_outline,
    read_geometries,
    reshape,
)
from semap.store.map.frames import set_pose
from semap.store.map.history import lock_edits
from semap.store.map.maps import map_id_of
from semap.store.map.placement import map_from_frames, pose_in

Carried = Literal["refuse", "delete", "keep"]


class Keep(Enum):
    """Says that something is left as it is, where None has a meaning of its own."""

    KEEP = "keep"


KEEP = Keep.KEEP


@dataclass(frozen=True, eq=False)
class Changes:
    """What an edit changes; None, or KEEP, leaves a thing as it is.

    pose       map_T_instance
    body       in the instance's own frame; its outline and heights replace those that were there
    footprint  in the map frame; its heights stay unless a band is given
    band       heights of the footprint; None: those of the body, or every height without one
    """

    name: str | None = None
    alias: str | Keep | None = KEEP
    concept: str | None = None
    attributes: Mapping[str, object] | None = None
    pose: Pose | None = None
    body: Mesh | None = None
    footprint: Polygon | MultiPolygon | None = None
    band: HeightBand | Keep | None = KEEP


@dataclass(frozen=True)
class Held:
    """The row of an instance whose map is held still until the transaction ends."""

    instance_id: int
    map_id: int
    name: str
    frame_id: int
    relative_id: int | None


def create_instance(connection: Connection, map_name: str, item: Item) -> int:
    """A new instance on a map; returns its id.

    raises  NotFound if there is no such map, Conflict if the name or uid is taken, InvalidInput if its
            concept, its storey or a room that it joins is unknown, or its shape has no area
    """
    map_id = map_id_of(connection, map_name)
    concept_ids = {item.concept: concept_id(connection, item.concept)}
    described = describe(item)
    _require_known(connection, map_id, item)
    insert_items(connection, map_id, [item], [described], concept_ids)
    with translated():
        made = connection.scalar(
            select(instance.c.instance_id).where(instance.c.map_id == map_id, instance.c.name == item.name)
        )
    return int(made or 0)


def edit_instance(connection: Connection, instance_id: int, changes: Changes) -> None:
    """Change an instance; what follows from what changes is kept true by the database.

    An instance of a shared description that gets another shape has a description of its own from then on.
    raises  NotFound, Conflict if the new name is taken, InvalidInput for an outline that is not an area, an
            unknown concept or description, or heights of nothing
    """
    held = hold_instance(connection, instance_id)
    _edit_row(connection, held, changes)
    if changes.pose is not None:
        _place(connection, held, changes.pose)
    if changes.body is not None or changes.footprint is not None or not isinstance(changes.band, Keep):
        _reshape(connection, held, changes)


def delete_instance(connection: Connection, instance_id: int, carried: Carried = "refuse") -> None:
    """Delete an instance, with its frame and what is its own.

    carried  what becomes of the things whose frames stand in its own: 'delete' them too, 'keep' them where
             they are, on what carried this instance, or 'refuse'
    raises   NotFound, Conflict if it carries other things and `carried` is 'refuse'
    """
    held = hold_instance(connection, instance_id)
    with translated():
        standing = list(
            connection.scalars(
                select(frame.c.name).where(frame.c.parent_id == held.frame_id).order_by(frame.c.name).limit(5)
            )
        )
        if standing and carried == "refuse":
            raise Conflict(
                f"{held.name} carries other things: {', '.join(standing)}.",
                "Delete the instances on it first, or choose their fate (carried=delete or keep).",
            )
        connection.execute(select(func.semap.delete_instance(instance_id, carried == "delete")))


def _require_known(connection: Connection, map_id: int, item: Item) -> None:
    with translated():
        rows = connection.execute(
            select(instance.c.name, concept.c.name)
            .join(concept, concept.c.concept_id == instance.c.concept_id)
            .where(instance.c.map_id == map_id, one_of(instance.c.name, {item.storey, *item.joins} - {None}))
        )
        known = dict(rows.all())
    if item.storey is not None and known.get(item.storey) != "Storey":
        raise InvalidInput(f"there is no storey {item.storey} on this map", "Name another storey.", "storey")
    for name in item.joins:
        if name not in known:
            raise InvalidInput(f"there is nothing named {name} on this map", "Create it first.", "joins")


def hold_instance(connection: Connection, instance_id: int) -> Held:
    """Regions first, rows second: the order in which an import locks them too."""
    with translated():
        lock_edits(connection)
        row = connection.execute(
            select(
                instance.c.instance_id,
                instance.c.map_id,
                instance.c.name,
                instance.c.frame_id,
                instance.c.relative_description_id,
            ).where(instance.c.instance_id == instance_id)
        ).one_or_none()
    if row is None:
        raise NotFound("instance", instance_id, "List the instances to see their ids.")
    return Held(*row)


def _edit_row(connection: Connection, held: Held, changes: Changes) -> None:
    values: dict[str, object] = {}
    if changes.name is not None:
        values["name"] = changes.name
    if not isinstance(changes.alias, Keep):
        values["alias"] = changes.alias
    if changes.concept is not None:
        values["concept_id"] = concept_id(connection, changes.concept)
    if changes.attributes is not None:
        values["attributes"] = json.loads(json.dumps(dict(changes.attributes), default=str))
    with translated():
        kept = connection.execute(
            update(instance)
            .where(instance.c.instance_id == held.instance_id)
            .values(updated_at=func.clock_timestamp(), **values)
            .returning(instance.c.name, instance.c.concept_id, instance.c.attributes)
        ).one()
        if changes.concept is not None or changes.attributes is not None:
            kind = connection.scalar(select(concept.c.name).where(concept.c.concept_id == kept.concept_id))
            check_attributes(connection, [(kept.name, str(kind), kept.attributes)])
        if changes.name is not None:
            connection.execute(
                update(frame)
                .where(frame.c.frame_id == held.frame_id, frame.c.name == held.name)
                .values(name=changes.name)
            )


def _place(connection: Connection, held: Held, pose: Pose) -> None:
    with translated():
        parent_id = connection.scalar(select(frame.c.parent_id).where(frame.c.frame_id == held.frame_id))
    if parent_id is None:
        raise Conflict("It stands on a root frame, with other things.", "Put it on a frame of its own first.")
    map_T_parent = map_from_frames(connection, [parent_id])[parent_id]
    set_pose(connection, held.frame_id, pose_in(map_T_parent, pose))


def _reshape(connection: Connection, held: Held, changes: Changes) -> None:
    map_T_item = map_from_frames(connection, [held.frame_id])[held.frame_id]
    sources: tuple[SourceGeometry, ...] = ()
    if held.relative_id is not None:
        sources = read_geometries(connection, [held.relative_id]).get(held.relative_id, ())
    if changes.body is not None:
        sources = (SourceGeometry(BODY, "TRIANGLEMESH3D", changes.body),)
    present = next((each for each in sources if each.name == OUTLINE), None)
    outline: SourceGeometry | None
    if changes.footprint is not None:
        outline = outline_of(map_T_item, changes.footprint, None)
        outline = replace(outline, band=None if present is None else present.band)
    elif isinstance(changes.band, Keep) or changes.band is None:
        outline = present
    else:
        outline = own_outline(sources)
    if outline is not None and not isinstance(changes.band, Keep):
        outline = replace(outline, band=band_within(outline, map_T_item, changes.band))
    if changes.body is None and present is not None and outline is not None:
        sources = tuple(_following(each, present, outline) for each in sources)
    sources = tuple(each for each in sources if each.name != OUTLINE)
    reshape(
        connection, _own_description(connection, held), sources if outline is None else (*sources, outline)
    )


def _following(source: SourceGeometry, before: SourceGeometry, after: SourceGeometry) -> SourceGeometry:
    """A body that is just the prism over the outline becomes the one over the new outline; others stay."""
    if source.name != BODY or not isinstance(source.shape, Mesh) or before.band is None or after.band is None:
        return source
    if any(each.pose != IDENTITY for each in (source, before, after)):
        return source
    assert isinstance(before.shape, Polygon | MultiPolygon)  # noqa: S101  (an outline is an area)
    if not is_prism(source.shape, before.shape, before.band.z_min_m, before.band.z_max_m):
        return source
    assert isinstance(after.shape, Polygon | MultiPolygon)  # noqa: S101
    return replace(source, shape=extrude(after.shape, after.band.z_min_m, after.band.z_max_m))


def _own_description(connection: Connection, held: Held) -> int:
    """The description that is the instance's alone: the one that it has, or a new one."""
    with translated():
        shared = connection.scalar(
            select(func.semap.description_is_shared(held.relative_id, held.instance_id))
        )
        if held.relative_id is not None and not shared:
            return held.relative_id
        (own_id,) = insert_descriptions(connection, held.map_id, [None])
        connection.execute(
            update(instance)
            .where(instance.c.instance_id == held.instance_id)
            .values(relative_description_id=own_id)
        )
    return own_id
