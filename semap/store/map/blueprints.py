"""Blueprints: descriptions with a name, shared by the instances that look like them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, func, select, text, update

from semap.errors import InvalidInput, NotFound
from semap.model.building import HeightBand
from semap.model.pose import Pose
from semap.model.source_geometry import GeometryType, SourceGeometry
from semap.store.database.connection import translated
from semap.store.database.tables import description, instance
from semap.store.map.description import insert_descriptions, read_geometries, reshape
from semap.store.map.history import lock_edits
from semap.store.map.maps import map_id_of

BLUEPRINTS = """
    select d.description_id, m.name, d.name,
           (select count(*) from semap.instance i where i.relative_description_id = d.description_id),
           coalesce((select array_agg(a.type order by a.type) from semap.abstraction a
                     where a.description_id = d.description_id), '{}')
    from semap.description d join semap.map m using (map_id)
    where not d.is_absolute
"""
LIST_BLUEPRINTS = text(
    f"{BLUEPRINTS} and m.name = :map_name and d.name is not null and d.description_id > :after"
    " order by d.description_id limit :limit"
)
LIST_GEOMETRIES = text("""
    select name, type, x_m, y_m, z_m, qx, qy, qz, qw, z_min_m, z_max_m
    from semap.geometry where description_id = :description_id order by name
""")
GET_BLUEPRINT = text(f"{BLUEPRINTS} and d.description_id = :description_id")


@dataclass(frozen=True, eq=False)
class Blueprint:
    """A description as lists show it; without a name it is one instance's own.

    instances     how many look like it
    abstractions  the types of what is derived from its geometries
    """

    description_id: int
    map: str
    name: str | None
    instances: int
    abstractions: tuple[str, ...]


@dataclass(frozen=True)
class GeometryHead:
    """A source geometry without its shape; `pose` is description_T_geometry."""

    name: str
    type: GeometryType
    pose: Pose
    band: HeightBand | None


def list_blueprints(
    connection: Connection, map_name: str, *, after: int = 0, limit: int = 100
) -> tuple[Blueprint, ...]:
    """At most `limit` blueprints of a map in the order of their ids, from the first after `after`.

    raises  NotFound if there is no such map
    """
    map_id_of(connection, map_name)
    with translated():
        rows = connection.execute(LIST_BLUEPRINTS, {"map_name": map_name, "after": after, "limit": limit})
        return tuple(_blueprint(row) for row in rows)


def get_blueprint(connection: Connection, description_id: int) -> Blueprint:
    """raises NotFound"""
    with translated():
        row = connection.execute(GET_BLUEPRINT, {"description_id": description_id}).one_or_none()
    if row is None:
        raise NotFound("description", description_id, "List the descriptions of the map to see their ids.")
    return _blueprint(row)


def geometries_of(connection: Connection, description_id: int) -> tuple[SourceGeometry, ...]:
    """raises NotFound"""
    get_blueprint(connection, description_id)
    return read_geometries(connection, [description_id]).get(description_id, ())


def list_geometries(connection: Connection, description_id: int) -> tuple[GeometryHead, ...]:
    """The source geometries of a description by name, without their shapes."""
    with translated():
        rows = connection.execute(LIST_GEOMETRIES, {"description_id": description_id})
        return tuple(
            GeometryHead(
                name,
                type_,
                Pose(*numbers[:7]),
                None if numbers[7] is None or numbers[8] is None else HeightBand(*numbers[7:]),
            )
            for name, type_, *numbers in rows
        )


def create_blueprint(
    connection: Connection, map_name: str, name: str, sources: Sequence[SourceGeometry] = ()
) -> Blueprint:
    """A new blueprint of these geometries.

    raises  NotFound if there is no such map, Conflict if the name is taken
    """
    (made,) = insert_descriptions(connection, map_id_of(connection, map_name), [name])
    reshape(connection, made, sources)
    return get_blueprint(connection, made)


def put_geometry(connection: Connection, description_id: int, source: SourceGeometry) -> None:
    """Add a geometry, or replace the one of its name; every instance of the description follows.

    raises  NotFound
    """
    others = [each for each in _held(connection, description_id) if each.name != source.name]
    reshape(connection, description_id, [*others, source])


def remove_geometry(connection: Connection, description_id: int, name: str) -> None:
    """raises NotFound"""
    present = _held(connection, description_id)
    others = [each for each in present if each.name != name]
    if len(others) == len(present):
        raise NotFound("geometry", name, f"It was looked for in the description {description_id}.")
    reshape(connection, description_id, others)


def rename_blueprint(connection: Connection, description_id: int, name: str) -> Blueprint:
    """raises NotFound, Conflict if the name is taken"""
    get_blueprint(connection, description_id)
    with translated():
        connection.execute(
            update(description).where(description.c.description_id == description_id).values(name=name)
        )
    return get_blueprint(connection, description_id)


def delete_blueprint(connection: Connection, description_id: int, replacement_id: int | None = None) -> None:
    """Delete a description; its instances look like the replacement from then on, or like nothing.

    raises  NotFound, InvalidInput if the replacement is of another map
    """
    known = get_blueprint(connection, description_id)
    if replacement_id is not None and get_blueprint(connection, replacement_id).map != known.map:
        raise InvalidInput(
            "a replacement on another map", "Name a description of the same map.", "replacement"
        )
    with translated():
        connection.execute(select(func.semap.delete_description(description_id, replacement_id)))


def switch_description(connection: Connection, instance_id: int, description_id: int | None) -> None:
    """Let an instance look like another description of its map; None: like nothing.

    raises  NotFound, InvalidInput if the description is on another map or one instance's own
    """
    with translated():
        lock_edits(connection)
        map_id = connection.scalar(select(instance.c.map_id).where(instance.c.instance_id == instance_id))
    if map_id is None:
        raise NotFound("instance", instance_id, "List the instances to see their ids.")
    if description_id is not None:
        with translated():
            found = connection.execute(
                select(description.c.map_id, description.c.name).where(
                    description.c.description_id == description_id, ~description.c.is_absolute
                )
            ).one_or_none()
        if found is None:
            raise NotFound(
                "description", description_id, "List the descriptions of the map to see their ids."
            )
        if found.map_id != map_id or found.name is None:
            raise InvalidInput(
                "a description of another map, or of another instance alone",
                "Name a blueprint of the same map.",
                "description",
            )
    with translated():
        connection.execute(
            update(instance)
            .where(instance.c.instance_id == instance_id)
            .values(relative_description_id=description_id, updated_at=func.clock_timestamp())
        )


def _held(connection: Connection, description_id: int) -> tuple[SourceGeometry, ...]:
    """The geometries, after every other edit has ended and before the next begins."""
    with translated():
        lock_edits(connection)
    return geometries_of(connection, description_id)


def _blueprint(row: Sequence[Any]) -> Blueprint:
    description_id, map_name, name, instances, types = row
    return Blueprint(description_id, map_name, name, instances, tuple(types))
