"""semap door"""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from semap_service.cli.output import print_rows
from semap_service.cli.session import AsJson, Dsn, database


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Doors that have a leaf, and how they stand.")
    app.command("list")(list_all)
    app.callback()(_nothing)
    return app


def list_all(
    map_name: Annotated[str | None, typer.Option("--map", help="Only those of this map.")] = None,
    after: Annotated[int, typer.Option(help="Only those after this number.", min=0)] = 0,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """List the doors with a leaf: state, since when, angle, and the rooms that each joins."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap.store.motion.doors import list_doors  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = list_doors(connection, map_name=map_name, after=after, limit=1000)
    rows = [{name: _shown(value, as_json) for name, value in asdict(each).items()} for each in found]
    print_rows(rows, as_json, "No door has a leaf. In a map, say: leaf: left, or leaf: right.")


def _shown(value: object, as_json: bool) -> object:
    if as_json:
        return value
    if isinstance(value, float):
        return f"{value:.1f}"
    return ", ".join(map(str, value)) if isinstance(value, tuple) else value


def _nothing() -> None:
    """Keep the name of the command even while there is but one."""
