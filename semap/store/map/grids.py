"""Occupancy grids: backdrops of a map."""

from __future__ import annotations

import numpy as np
from sqlalchemy import Connection, delete, select
from sqlalchemy.dialects.postgresql import insert

from semap.errors import NotFound
from semap.model.map_document import OccupancyGrid
from semap.store.database.connection import translated
from semap.store.database.name import require_name
from semap.store.database.tables import map_grid
from semap.store.map.maps import map_id_of


def read_grids(
    connection: Connection,
    map_name: str,
    name: str | None = None,
    *,
    after: str = "",
    limit: int | None = None,
) -> tuple[OccupancyGrid, ...]:
    """The grids of a map by name, or the one of a name; all after `after`, or at most `limit`.

    raises  NotFound if there is no such map
    """
    found = select(map_grid).where(
        map_grid.c.map_id == map_id_of(connection, map_name), map_grid.c.name > after
    )
    if name is not None:
        found = found.where(map_grid.c.name == name)
    with translated():
        return tuple(
            OccupancyGrid(
                row.name,
                row.resolution_m,
                (row.origin_x_m, row.origin_y_m, row.origin_yaw_rad),
                np.frombuffer(row.pixels, dtype=np.uint8).reshape(row.height, row.width),
                row.negate,
                (row.occupied_thresh, row.free_thresh),
                row.mode,
            )
            for row in connection.execute(found.order_by(map_grid.c.name).limit(limit))
        )


def put_grid(connection: Connection, map_name: str, grid: OccupancyGrid) -> None:
    """Add a grid to a map, or replace the one of its name.

    raises  NotFound if there is no such map
    """
    require_name(grid.name)
    x_m, y_m, yaw_rad = grid.origin
    height, width = grid.pixels.shape
    values = {
        "resolution_m": grid.resolution_m,
        "origin_x_m": x_m,
        "origin_y_m": y_m,
        "origin_yaw_rad": yaw_rad,
        "negate": grid.negate,
        "occupied_thresh": grid.thresholds[0],
        "free_thresh": grid.thresholds[1],
        "mode": grid.mode,
        "width": width,
        "height": height,
        "pixels": grid.pixels.tobytes(),
    }
    map_id = map_id_of(connection, map_name)
    with translated():
        connection.execute(
            insert(map_grid)
            .values(map_id=map_id, name=grid.name, **values)
            .on_conflict_do_update(index_elements=["map_id", "name"], set_=values)
        )


def delete_grid(connection: Connection, map_name: str, name: str) -> None:
    """raises NotFound"""
    map_id = map_id_of(connection, map_name)
    with translated():
        gone = connection.execute(
            delete(map_grid).where(map_grid.c.map_id == map_id, map_grid.c.name == name)
        ).rowcount
    if not gone:
        raise NotFound("grid", name, f"It was looked for on map {map_name}.")
