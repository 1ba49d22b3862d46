"""Things put on a map through the store, and operators asked in plain SQL."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from uuid import uuid4

import numpy as np
from shapely import MultiPolygon, Polygon
from sqlalchemy import Connection, text

from semap.geometry.prism import extrude
from semap.model.building import Building, HeightBand, Item, Mesh, Storey
from semap.model.pose import IDENTITY, Pose
from semap.store.map.building import import_building
from semap.store.map.maps import create_map


class House:
    """A map of its own within a transaction; things are put on it all at once, and known by their names."""

    def __init__(self, connection: Connection, name: str = "house") -> None:
        self.connection = connection
        self.name = name
        self.map_id = create_map(connection, name).map_id
        self.ids: dict[str, int] = {}

    def put(self, *items: Item, storeys: tuple[Storey, ...] = ()) -> None:
        import_building(self.connection, self.name, Building(storeys, items))
        self.ids |= dict(
            self.connection.execute(
                text("select name, instance_id from semap.instance where map_id = :map_id"),
                {"map_id": self.map_id},
            ).all()
        )

    def of(self, *names: str) -> list[int]:
        return [self.ids[name] for name in names]

    def named(self, ids: object) -> set[str]:
        names = {id_: name for name, id_ in self.ids.items()}
        return {names[id_] for id_ in ids}

    def rows(self, statement: str, **values: object) -> list[tuple]:
        return [tuple(row) for row in self.connection.execute(text(statement), values)]

    def one(self, statement: str, **values: object):
        return self.connection.execute(text(statement), values).scalar_one()

    def world_poses(self) -> dict[str, np.ndarray]:
        """map_T_instance of everything on the map."""
        rows = self.rows(
            "select i.name, (p.pose).* from semap.instance i, lateral semap.frames_in_root(array[i.frame_id]) p"
            " where i.map_id = :map_id",
            map_id=self.map_id,
        )
        return {name: Pose(*pose).matrix() for name, *pose in rows}

    @contextmanager
    def undone(self) -> Iterator[None]:
        """What happens inside is as if it never was."""
        savepoint = self.connection.begin_nested()
        known = dict(self.ids)
        try:
            yield
        finally:
            savepoint.rollback()
            self.ids = known


def room(
    name: str,
    area: Polygon | MultiPolygon,
    heights: tuple[float, float] | None = (0.0, 2.5),
    concept: str = "Room",
    **more: object,
) -> Item:
    """An area with heights, without a body."""
    band = None if heights is None else HeightBand(*heights)
    return Item(uuid4(), name, concept, footprint=area, band=band, **more)


def thing(
    name: str,
    body: Mesh,
    pose: Pose = IDENTITY,
    concept: str = "Furniture",
    attributes: Mapping[str, object] | None = None,
    **more: object,
) -> Item:
    """A body that stands somewhere."""
    return Item(uuid4(), name, concept, pose=pose, body=body, attributes=attributes or {}, **more)


def box(x_m: float, y_m: float, z_m: float) -> Mesh:
    """A box on the ground around the origin."""
    return extrude(
        Polygon([(-x_m / 2, -y_m / 2), (x_m / 2, -y_m / 2), (x_m / 2, y_m / 2), (-x_m / 2, y_m / 2)]), 0, z_m
    )
