"""Instances: made, edited and deleted, in the caller's transaction.

What is derived from a pose or a body follows in the same transaction: whoever reads the map never sees
one without the other. A frame carries the frames below it: moving a storey moves its rooms.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from sqlalchemy import Connection, delete, func, select, text, update

from semap.errors import Conflict, InvalidInput, NotFound
from semap.geometry.abstractions import Abstraction
from semap.geometry.tin import mesh_from_wkb
from semap.model.building import HeightBand, Item, Mesh
from semap.model.pose import Pose
from semap.store.building import insert_items
from semap.store.concept import concept_id
from semap.store.database import translated
from semap.store.description import (
    Outline,
    carried,
    describe,
    insert_descriptions,
    is_upright,
    write_abstractions,
    write_bodies,
)
from semap.store.maps import map_id_of
from semap.store.placement import map_from_frames, normalised, place_frames, pose_in
from semap.store.tables import abstraction, concept, description, frame, geometry, instance, one_of

MOVED = text("""
    with recursive below (frame_id) as (
      select cast(:frame_id as bigint)
      union all
      select f.frame_id from semap.frame f join below b on f.parent_id = b.frame_id
    )
    select i.instance_id, i.name, i.frame_id, i.relative_description_id, i.absolute_description_id
    from below join semap.instance i using (frame_id)
    where i.absolute_description_id is not null
    order by i.instance_id
""")


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
    absolute_id: int | None


def create_instance(connection: Connection, map_name: str, item: Item) -> int:
    """A new instance on a map; returns its id.

    raises  NotFound if there is no such map, Conflict if the name or uid is taken, InvalidInput if its
            concept, its storey or a room that it joins is unknown, or its shape has no area
    """
    map_id = map_id_of(connection, map_name)
    concept_ids = {item.concept: concept_id(connection, item.concept)}
    described = describe(normalised(item.pose).matrix(), item.body, Outline(item.footprint, item.band))
    _require_known(connection, map_id, item)
    insert_items(connection, map_id, [item], [described], concept_ids)
    with translated():
        made = connection.scalar(
            select(instance.c.instance_id).where(instance.c.map_id == map_id, instance.c.name == item.name)
        )
    return int(made or 0)


def edit_instance(connection: Connection, instance_id: int, changes: Changes) -> None:
    """Change an instance, and whatever is derived from what changes.

    raises  NotFound, Conflict if the new name is taken, InvalidInput for a shape without area, an unknown
            concept, or a pose that tilts an outline which has no body
    """
    held = _hold(connection, instance_id)
    _edit_row(connection, held, changes)
    if changes.pose is not None:
        _place(connection, held, changes.pose)
    is_reshaped = (
        changes.body is not None or changes.footprint is not None or not isinstance(changes.band, Keep)
    )
    rows: list[tuple[int, Abstraction]] = []
    if is_reshaped:
        held = _with_descriptions(connection, held)
        rows += _reshaped(connection, held, changes)
    if changes.pose is not None:
        rows += _carried(connection, held, without_own=is_reshaped)
    write_abstractions(connection, rows)


def delete_instance(connection: Connection, instance_id: int) -> None:
    """Delete an instance with its frame and descriptions.

    raises  NotFound, Conflict if the frames of other things stand in its own: they would lose their place
    """
    held = _hold(connection, instance_id)
    with translated():
        standing = list(
            connection.scalars(
                select(frame.c.name).where(frame.c.parent_id == held.frame_id).order_by(frame.c.name).limit(5)
            )
        )
        if standing:
            raise Conflict(
                f"{held.name} carries other things: {', '.join(standing)}.", "Delete what stands on it first."
            )
        connection.execute(delete(instance).where(instance.c.instance_id == instance_id))
        own = [id_ for id_ in (held.relative_id, held.absolute_id) if id_ is not None]
        connection.execute(delete(description).where(one_of(description.c.description_id, own)))
        connection.execute(delete(frame).where(frame.c.frame_id == held.frame_id))


def _require_known(connection: Connection, map_id: int, item: Item) -> None:
    with translated():
        rows = connection.execute(
            select(instance.c.name, concept.c.name)
            .join(concept)
            .where(instance.c.map_id == map_id, one_of(instance.c.name, {item.storey, *item.joins} - {None}))
        )
        known = dict(rows.all())
    if item.storey is not None and known.get(item.storey) != "Storey":
        raise InvalidInput(f"there is no storey {item.storey} on this map", "Name another storey.", "storey")
    for name in item.joins:
        if name not in known:
            raise InvalidInput(f"there is nothing named {name} on this map", "Create it first.", "joins")


def _hold(connection: Connection, instance_id: int) -> Held:
    """Regions first, rows second: the order in which an import locks them too."""
    with translated():
        connection.execute(select(func.semap.change_regions()))
        row = connection.execute(
            select(
                instance.c.instance_id,
                instance.c.map_id,
                instance.c.name,
                instance.c.frame_id,
                instance.c.relative_description_id,
                instance.c.absolute_description_id,
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
        connection.execute(
            update(instance)
            .where(instance.c.instance_id == held.instance_id)
            .values(updated_at=func.clock_timestamp(), **values)
        )
        if changes.name is not None:
            connection.execute(
                update(frame)
                .where(frame.c.frame_id == held.frame_id, frame.c.name == held.name)
                .values(name=changes.name)
            )


def _place(connection: Connection, held: Held, pose: Pose) -> None:
    with translated():
        parent_id = connection.scalar(select(frame.c.parent_id).where(frame.c.frame_id == held.frame_id))
    map_T_parent = np.eye(4) if parent_id is None else map_from_frames(connection, [parent_id])[parent_id]
    place_frames(connection, {held.frame_id: pose_in(map_T_parent, pose)})


def _with_descriptions(connection: Connection, held: Held) -> Held:
    """The instance with both descriptions, made where it had none."""
    if held.relative_id is not None and held.absolute_id is not None:
        return held
    relative_id, absolute_id = insert_descriptions(connection, held.map_id, 2)
    with translated():
        connection.execute(
            update(instance)
            .where(instance.c.instance_id == held.instance_id)
            .values(relative_description_id=relative_id, absolute_description_id=absolute_id)
        )
    return Held(held.instance_id, held.map_id, held.name, held.frame_id, relative_id, absolute_id)


def _reshaped(connection: Connection, held: Held, changes: Changes) -> list[tuple[int, Abstraction]]:
    """The abstractions of both descriptions after a change of the body, the outline or its heights."""
    assert held.relative_id is not None  # noqa: S101  (see _with_descriptions)
    assert held.absolute_id is not None  # noqa: S101
    map_T_item = map_from_frames(connection, [held.frame_id])[held.frame_id]
    area, band = changes.footprint, changes.band
    if changes.body is None:
        present = _present(connection, held, changes, map_T_item)
        if area is None and present is None:
            raise InvalidInput("there is no footprint to give heights to", "Give a footprint too.", "band")
        if present is not None:
            area = area if area is not None else present.geometry
            band = _band(present) if isinstance(band, Keep) else band
    else:
        write_bodies(connection, [(held.relative_id, changes.body)])
    body = changes.body or _bodies(connection, [held.relative_id]).get(held.relative_id)
    described = describe(map_T_item, body, Outline(area, None if isinstance(band, Keep) else band))
    return [(held.relative_id, each) for each in described.relative] + [
        (held.absolute_id, each) for each in described.absolute
    ]


def _present(
    connection: Connection, held: Held, changes: Changes, map_T_item: NDArray[np.float64]
) -> Abstraction | None:
    """The footprint in the map frame as it would be without a change of shape."""
    assert held.absolute_id is not None  # noqa: S101
    if changes.pose is not None and changes.footprint is None:
        absolute = [each for _, each in _carried(connection, held, only_own=True)]
    else:
        absolute = _abstractions(connection, [held.absolute_id]).get(held.absolute_id, [])
    return next((each for each in absolute if each.type == "Footprint"), None)


def _carried(
    connection: Connection, held: Held, *, only_own: bool = False, without_own: bool = False
) -> list[tuple[int, Abstraction]]:
    """The absolute abstractions of the instance and of all that stands on it, where they are now."""
    with translated():
        rows = connection.execute(MOVED, {"frame_id": held.frame_id}).all()
    rows = [row for row in rows if not (without_own if row.instance_id == held.instance_id else only_own)]
    matrices = map_from_frames(connection, [row.frame_id for row in rows])
    relative = _abstractions(connection, [row.relative_description_id for row in rows])
    absolute = _abstractions(connection, [row.absolute_description_id for row in rows])
    tilted = [row.relative_description_id for row in rows if not is_upright(matrices[row.frame_id])]
    bodies = _bodies(connection, tilted)
    moved: list[tuple[int, Abstraction]] = []
    for row in rows:
        own = relative.get(row.relative_description_id, [])
        if row.absolute_description_id in absolute and not own:
            raise InvalidInput(
                f"{row.name} has an outline that was given while it was tilted",
                "Give its footprint together with its pose.",
                "pose",
            )
        body = bodies.get(row.relative_description_id)
        moved += [(row.absolute_description_id, each) for each in carried(matrices[row.frame_id], own, body)]
    return moved


def _abstractions(connection: Connection, description_ids: Sequence[int]) -> dict[int, list[Abstraction]]:
    found: dict[int, list[Abstraction]] = {}
    with translated():
        rows = connection.execute(
            select(
                abstraction.c.description_id,
                abstraction.c.type,
                func.public.st_asewkb(abstraction.c.geometry, type_=None),
                abstraction.c.z_min_m,
                abstraction.c.z_max_m,
            ).where(one_of(abstraction.c.description_id, description_ids))
        )
        for description_id, type_, wkb, z_min_m, z_max_m in rows:
            shape = shapely.from_wkb(bytes(wkb))
            found.setdefault(description_id, []).append(Abstraction(type_, shape, z_min_m, z_max_m))
    return found


def _bodies(connection: Connection, description_ids: Sequence[int]) -> dict[int, Mesh]:
    if not description_ids:
        return {}
    with translated():
        rows = connection.execute(
            select(geometry.c.description_id, func.public.st_asewkb(geometry.c.body, type_=None)).where(
                one_of(geometry.c.description_id, description_ids)
            )
        )
        return {description_id: mesh_from_wkb(bytes(wkb)) for description_id, wkb in rows}


def _band(present: Abstraction) -> HeightBand | None:
    if present.z_min_m is None or present.z_max_m is None:
        return None
    return HeightBand(present.z_min_m, present.z_max_m)
