"""semap map grid"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from semap_service.cli.output import print_rows
from semap_service.cli.session import AsJson, Dsn, MapName, database, signed_edit


def grid(
    map_name: MapName,
    file: Annotated[
        Path | None, typer.Argument(help="A grid as ROS's map_server writes it: the .yaml beside its .pgm.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Its name. [default: the file's name]")] = None,
    remove: Annotated[str | None, typer.Option(metavar="NAME", help="Remove the grid of this name.")] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Add an occupancy grid to a map as its backdrop, remove one, or list them.

    semap map grid office floor.yaml
    """
    from semap.formats.occupancy_grid import read_grid  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.grids import delete_grid, put_grid, read_grids  # noqa: PLC0415

    read = None if file is None else read_grid(file, name)
    with database(dsn, map_name) as opened:
        if read is not None or remove is not None:
            with signed_edit(opened, f"semap map grid {map_name}") as connection:
                if remove is not None:
                    delete_grid(connection, map_name, remove)
                if read is not None:
                    put_grid(connection, map_name, read)
        with one_transaction(opened, "semap_read") as connection:
            rows = [
                {
                    "name": each.name,
                    "width": each.pixels.shape[1],
                    "height": each.pixels.shape[0],
                    "resolution_m": each.resolution_m,
                    "origin": list(each.origin),
                }
                for each in read_grids(connection, map_name)
            ]
    print_rows(rows, as_json, f"Map {map_name} has no grids. Add one: semap map grid {map_name} floor.yaml")
