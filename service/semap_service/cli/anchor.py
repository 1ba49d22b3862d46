"""semap map anchor"""

from __future__ import annotations

from dataclasses import asdict
from math import radians
from typing import Annotated

import typer

from semap.errors import InvalidInput, NotFound
from semap_service.cli.output import print_json, say
from semap_service.cli.session import AsJson, Dsn, MapName, database, signed_edit


def anchor(
    map_name: MapName,
    epsg: Annotated[
        int | None, typer.Option(help="Set it: code of a projected system in metres, such as 25832.")
    ] = None,
    x_m: Annotated[float, typer.Option("--x", help="Easting of the map's origin [m].")] = 0.0,
    y_m: Annotated[float, typer.Option("--y", help="Northing of the map's origin [m].")] = 0.0,
    z_m: Annotated[float, typer.Option("--z", help="Height of the map's origin [m].")] = 0.0,
    yaw_deg: Annotated[
        float, typer.Option(help="How far the map's x axis is turned from east, counter-clockwise [degrees].")
    ] = 0.0,
    remove: Annotated[bool, typer.Option("--remove", help="Remove the anchor.")] = False,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show, set or remove the anchor of a map: its place on the earth.

    semap map anchor office --epsg 25832 --x 434500 --y 5791200 --yaw-deg 12.5
    """
    from semap.geometry.pose import pose_from_yaw  # noqa: PLC0415
    from semap.model.anchor import Anchor  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.anchor import read_anchor, remove_anchor, set_anchor  # noqa: PLC0415

    if remove and epsg is not None:
        raise InvalidInput("--remove and --epsg at once", "Give one of them.")
    with database(dsn, map_name) as opened:
        if remove:
            with signed_edit(opened, f"semap map anchor {map_name} --remove") as connection:
                remove_anchor(connection, map_name)
            say(f"Map {map_name} lies nowhere in particular.")
            return
        if epsg is not None:
            with signed_edit(opened, f"semap map anchor {map_name} --epsg {epsg}") as connection:
                set_anchor(connection, map_name, Anchor(epsg, pose_from_yaw(x_m, y_m, z_m, radians(yaw_deg))))
        with one_transaction(opened, "semap_read") as connection:
            found = read_anchor(connection, map_name)
    if found is None:
        raise NotFound(
            "anchor of the map", map_name, f"Set one: semap map anchor {map_name} --epsg 25832 ..."
        )
    if as_json:
        print_json(asdict(found))
        return
    pose = ", ".join(f"{key} {value:.6f}" for key, value in asdict(found.pose).items())
    say(f"Map {map_name} lies in EPSG:{found.epsg} at {pose}.")
