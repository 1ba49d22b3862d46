"""Many new instances at once, in the caller's transaction: a few statements for each thousand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sqlalchemy import Connection, select, text

from semap.errors import InvalidInput
from semap.model.building import Item
from semap.model.pose import Pose
from semap.store.database.connection import translated
from semap.store.database.tables import instance, one_of
from semap.store.map.building import describe, insert_items
from semap.store.map.concept import concept_id
from semap.store.map.instance_links import carry_by, place_locally

LOOK_LIKE = text("""
    update semap.instance i set relative_description_id = d.description_id
    from unnest(cast(:names as text[]), cast(:blueprints as text[])) as v (name, blueprint)
    join semap.description d on d.map_id = :map_id and d.name = v.blueprint and not d.is_absolute
    where i.map_id = :map_id and i.name = v.name
    returning i.name
""")


@dataclass(frozen=True, eq=False)
class NewInstance:
    """An item, and what it is connected to besides.

    blueprint   the description that it looks like; None: what the item says
    frame       the frame that carries it; None: that of its storey, else `map`
    local_pose  where it stands in that frame; None: where the item says
    """

    item: Item
    blueprint: str | None = None
    frame: str | None = None
    local_pose: Pose | None = None


def create_instances(connection: Connection, map_id: int, new: Sequence[NewInstance]) -> None:
    """Make instances; what they name must be on the map already, or come before them.

    raises  Conflict if a name or uid is taken, InvalidInput if a concept, a storey, a room, a blueprint or a
            frame is unknown, or a shape has no area
    """
    items = [each.item for each in new]
    concepts = {name: concept_id(connection, name) for name in {item.concept for item in items}}
    for note in insert_items(connection, map_id, items, [describe(item) for item in items], concepts):
        raise InvalidInput(note.reason, "Put what is named before what names it.", note.subject)
    _look_like(connection, map_id, {e.item.name: e.blueprint for e in new if e.blueprint is not None})
    elsewhere = [each for each in new if each.frame is not None or each.local_pose is not None]
    if elsewhere:
        ids = _ids(connection, map_id, [each.item.name for each in elsewhere])
        for each in elsewhere:
            if each.frame is not None:
                carry_by(connection, ids[each.item.name], each.frame)
            if each.local_pose is not None:
                place_locally(connection, ids[each.item.name], each.local_pose)


def _look_like(connection: Connection, map_id: int, blueprints: Mapping[str, str]) -> None:
    if not blueprints:
        return
    with translated():
        found = set(
            connection.scalars(
                LOOK_LIKE,
                {"map_id": map_id, "names": list(blueprints), "blueprints": list(blueprints.values())},
            )
        )
    for name, blueprint in blueprints.items():
        if name not in found:
            raise InvalidInput(
                f"there is no description {blueprint} on this map", "List the descriptions of the map.", name
            )


def _ids(connection: Connection, map_id: int, names: Sequence[str]) -> dict[str, int]:
    with translated():
        return dict(
            connection.execute(
                select(instance.c.name, instance.c.instance_id).where(
                    instance.c.map_id == map_id, one_of(instance.c.name, names)
                )
            ).all()
        )
