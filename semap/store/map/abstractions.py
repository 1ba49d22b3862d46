"""Abstractions as they are kept: of a description in its own frame, of an instance in the map frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import shapely
from sqlalchemy import Connection, func, select

from semap.errors import NotFound
from semap.geometry.direction import direction_region
from semap.geometry.ewkb import from_ewkb
from semap.model.building import HeightBand, Mesh
from semap.model.source_geometry import PolygonMesh
from semap.store.database.connection import translated
from semap.store.database.tables import abstraction, instance
from semap.store.map.blueprints import get_blueprint

AbstractionType = Literal[
    "Position2D",
    "Position3D",
    "AxisAligned2D",
    "FootprintBox",
    "FootprintHull",
    "Footprint",
    "AxisAligned3D",
    "BoundingBox",
    "BoundingHull",
]


Direction = Literal[
    "FrontProjection",
    "BackProjection",
    "LeftProjection",
    "RightProjection",
    "TopProjection",
    "BotProjection",
    "FrontHalfspace",
    "BackHalfspace",
    "LeftHalfspace",
    "RightHalfspace",
    "TopHalfspace",
    "BotHalfspace",
]
"""The names of `semap.geometry.direction`: regions that are not kept but made when they are asked for."""


@dataclass(frozen=True, eq=False)
class StoredAbstraction:
    """One abstraction.

    geometry  flat, a point with or without z, or a closed Mesh, by its type
    band      heights over which it holds; None: it has none, or holds at every height
    """

    type: AbstractionType
    geometry: shapely.Geometry | Mesh | PolygonMesh
    band: HeightBand | None


def abstraction_of_description(
    connection: Connection, description_id: int, type_: AbstractionType
) -> StoredAbstraction:
    """In the description's own frame.

    raises  NotFound if there is no such description, or nothing of this type follows from its geometries
    """
    get_blueprint(connection, description_id)
    return _read(connection, description_id, type_, f"description {description_id}")


def abstraction_of_instance(
    connection: Connection, instance_id: int, type_: AbstractionType
) -> StoredAbstraction:
    """In the map frame.

    raises  NotFound if there is no such instance, or nothing of this type follows from its description
    """
    with translated():
        row = connection.execute(
            select(instance.c.name, instance.c.absolute_description_id).where(
                instance.c.instance_id == instance_id
            )
        ).one_or_none()
    if row is None:
        raise NotFound("instance", instance_id, "List the instances to see their ids.")
    return _read(connection, row.absolute_description_id, type_, row.name)


def region_of_description(
    connection: Connection, description_id: int, direction: Direction, reach_m: float
) -> Mesh:
    """The region on one side of a description, in its own frame: see `semap.geometry.direction`.

    raises  NotFound if there is no such description or it has no extents, InvalidInput
    """
    extents = abstraction_of_description(connection, description_id, "AxisAligned3D").geometry
    assert isinstance(extents, Mesh)  # noqa: S101  (the schema says so)
    corners_m = extents.vertices_m
    return direction_region(direction, corners_m.min(axis=0), corners_m.max(axis=0), reach_m)


def region_of_instance(
    connection: Connection, instance_id: int, direction: Direction, reach_m: float
) -> Mesh:
    """The region on one side of an instance, of its own axes, in the map frame.

    raises  NotFound if there is no such instance or it has no extents, InvalidInput
    """
    with translated():
        row = connection.execute(
            select(
                instance.c.name,
                func.public.st_asewkb(func.semap.region_of(instance_id, direction, reach_m), type_=None),
            ).where(instance.c.instance_id == instance_id)
        ).one_or_none()
    if row is None:
        raise NotFound("instance", instance_id, "List the instances to see their ids.")
    name, ewkb = row
    if ewkb is None:
        raise NotFound(direction, f"of {name}", "It has no shape: give it a description.")
    region = from_ewkb(bytes(ewkb))
    assert isinstance(region, Mesh)  # noqa: S101  (it is a TIN)
    return region


def _read(
    connection: Connection, description_id: int | None, type_: AbstractionType, owner: str
) -> StoredAbstraction:
    with translated():
        row = connection.execute(
            select(
                func.public.st_asewkb(abstraction.c.geometry, type_=None),
                abstraction.c.z_min_m,
                abstraction.c.z_max_m,
            ).where(abstraction.c.description_id == description_id, abstraction.c.type == type_)
        ).one_or_none()
    if row is None:
        raise NotFound(
            type_, f"of {owner}", "Nothing of this type follows from its geometries: see what types it has."
        )
    ewkb, z_min_m, z_max_m = row
    band = None if z_min_m is None or z_max_m is None else HeightBand(z_min_m, z_max_m)
    return StoredAbstraction(type_, from_ewkb(bytes(ewkb)), band)
