"""What an instance is connected to: the frame that carries it, its storey, the rooms that a door joins."""

from __future__ import annotations

from collections.abc import Sequence

from sqlalchemy import Connection, delete, func, insert, select, update

from semap.errors import InvalidInput, NotFound
from semap.model.pose import Pose
from semap.store.blueprints import switch_description
from semap.store.database import translated
from semap.store.frames import Keep, change_frame, frame_named, set_pose
from semap.store.instance_edit import hold_instance
from semap.store.tables import concept, description, door_room, instance, map_

STOREY = "Storey"


def describe_as(connection: Connection, instance_id: int, blueprint: str | None) -> None:
    """Let an instance look like the blueprint of a name; None: like nothing.

    raises  NotFound, InvalidInput if its map has no such blueprint
    """
    held = hold_instance(connection, instance_id)
    found = None
    if blueprint is not None:
        with translated():
            found = connection.scalar(
                select(description.c.description_id).where(
                    description.c.map_id == held.map_id, description.c.name == blueprint
                )
            )
        if found is None:
            raise InvalidInput(
                f"there is no description {blueprint} on this map",
                "List the descriptions of the map.",
                "description",
            )
    switch_description(connection, instance_id, found)


def carry_by(connection: Connection, instance_id: int, parent: str, keep: Keep = "world") -> None:
    """Let the frame of a name carry an instance.

    keep    'world': it stays where it is; 'local': it keeps its pose and moves with its new parent
    raises  NotFound, InvalidInput if there is no such frame, or it stands on the instance itself
    """
    held = hold_instance(connection, instance_id)
    with translated():
        map_name = connection.scalar(select(map_.c.name).where(map_.c.map_id == held.map_id))
    try:
        frame_named(connection, str(map_name), parent)
    except NotFound as error:
        raise InvalidInput(str(error), error.remedy, "frame") from error
    change_frame(connection, held.frame_id, parent, keep)


def place_locally(connection: Connection, instance_id: int, pose: Pose) -> None:
    """Set where an instance stands in the frame that carries it: parent_T_instance.

    raises  NotFound, InvalidInput for a pose without a rotation
    """
    set_pose(connection, hold_instance(connection, instance_id).frame_id, pose)


def set_storey(connection: Connection, instance_id: int, storey: str | None) -> None:
    """Say on which storey an instance is; None: on none. Where it stands does not change.

    raises  NotFound, InvalidInput if its map has no such storey
    """
    held = hold_instance(connection, instance_id)
    storey_id = None
    with translated():
        if storey is not None:
            storey_id = connection.scalar(
                select(instance.c.instance_id)
                .join(concept, concept.c.concept_id == instance.c.concept_id)
                .where(instance.c.map_id == held.map_id, instance.c.name == storey, concept.c.name == STOREY)
            )
            if storey_id is None:
                raise InvalidInput(
                    f"there is no storey {storey} on this map", "Name another storey.", "storey"
                )
        connection.execute(
            update(instance)
            .where(instance.c.instance_id == instance_id)
            .values(storey_id=storey_id, updated_at=func.clock_timestamp())
        )


def set_joins(connection: Connection, instance_id: int, rooms: Sequence[str]) -> None:
    """Let a door join these rooms, and no others.

    raises  NotFound, InvalidInput if its map has no instance of such a name, or it names itself
    """
    held = hold_instance(connection, instance_id)
    with translated():
        known = dict(
            connection.execute(
                select(instance.c.name, instance.c.instance_id).where(
                    instance.c.map_id == held.map_id, instance.c.name.in_(list(rooms))
                )
            ).all()
        )
        for name in rooms:
            if name not in known or known[name] == instance_id:
                raise InvalidInput(
                    f"there is no other thing named {name} on this map", "Create it first.", "joins"
                )
        room_ids = sorted(set(known.values()))
        connection.execute(
            delete(door_room).where(door_room.c.door_id == instance_id, door_room.c.room_id.not_in(room_ids))
        )
        present = set(
            connection.scalars(select(door_room.c.room_id).where(door_room.c.door_id == instance_id))
        )
        new = [{"door_id": instance_id, "room_id": id_} for id_ in room_ids if id_ not in present]
        if new:
            connection.execute(insert(door_room).values(new))
        connection.execute(
            update(instance)
            .where(instance.c.instance_id == instance_id)
            .values(updated_at=func.clock_timestamp())
        )


def copy_instance(connection: Connection, instance_id: int, name: str) -> int:
    """A copy under another name, on the same frame at the same place; returns its id.

    raises  NotFound, Conflict if the name is taken
    """
    hold_instance(connection, instance_id)
    with translated():
        return int(connection.scalar(select(func.semap.copy_instance(instance_id, name))) or 0)
