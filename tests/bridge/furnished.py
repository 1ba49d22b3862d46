"""A map with two rooms, a door between them, and a table that has a mesh."""

from __future__ import annotations

from uuid import NAMESPACE_URL, uuid5

import numpy as np
import shapely
import trimesh
from world import World

from semap.model.building import Building, HeightBand, Item, Mesh
from semap.model.pose import Pose
from semap.store.database.connection import one_transaction
from semap.store.map.building import import_building

TABLE_M = (1.2, 0.8, 0.7)


def furnish(world: World) -> None:
    """kitchen, x 0 to 4; hall, x 4 to 9; door at x 4, y 1 to 2; table, turned by a quarter, at 2, 2."""
    box = trimesh.creation.box(TABLE_M)
    items = (
        _room("kitchen", shapely.box(0, 0, 4, 3)),
        _room("hall", shapely.box(4, 0, 9, 5)),
        Item(
            _uid("door"), "door", "Door", pose=Pose(4, 1.5, 0, 0, 0, 2**-0.5, 2**-0.5),
            joins=("kitchen", "hall"), attributes={"width_m": 1.0},
        ),
        Item(
            _uid("table"), "table", "Table", pose=Pose(2, 2, 0.35, 0, 0, 2**-0.5, 2**-0.5),
            body=Mesh(np.asarray(box.vertices), np.asarray(box.faces)),
        ),
    )  # fmt: skip
    with one_transaction(world.dsn) as connection:
        import_building(connection, world.name, Building((), items))


def _room(name: str, area: shapely.Polygon) -> Item:
    return Item(_uid(name), name, "Room", footprint=area, band=HeightBand(0, 2.5))


def _uid(name: str):
    return uuid5(NAMESPACE_URL, f"furnished/{name}")
