"""semap map"""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from semap_service.cli import anchor, exchange, frames, grids, history, shards
from semap_service.cli.output import print_rows, say
from semap_service.cli.session import AsJson, Cell, Dsn, MapName, database, signed_edit


def commands() -> typer.Typer:
    app = typer.Typer(
        no_args_is_help=True, help="Maps: bring them in and out, see what is there, who changed it, and undo."
    )
    app.command("import")(exchange.import_file)
    app.command("export")(exchange.export_file)
    app.command("list")(list_all)
    app.command("show")(show)
    app.command("create")(create)
    app.command("delete")(delete)
    app.command("frames")(frames.frames)
    app.command("transform")(frames.transform)
    app.command("anchor")(anchor.anchor)
    app.command("grid")(grids.grid)
    app.command("history")(history.history)
    app.command("undo")(history.undo)
    app.command("place")(shards.place)
    return app


def list_all(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the maps."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import list_maps  # noqa: PLC0415
    from semap.store.map.places import has_shards, list_shards  # noqa: PLC0415

    with database(dsn) as opened:
        with one_transaction(opened, "semap_read") as connection:
            rows = [asdict(found) for found in list_maps(connection)]
            several = has_shards(connection)
        if several:
            with one_transaction(opened, "semap_admin") as connection:
                known = list_shards(connection)
            rows = []
            for shard in known:
                with one_transaction(shard.dsn or opened, "semap_read") as connection:
                    rows += [{**asdict(found), "shard": shard.name} for found in list_maps(connection)]
            rows.sort(key=lambda row: str(row["name"]))
    print_rows(rows, as_json, "No maps yet. Import one: semap map import BUILDING.geojson")


def show(
    name: MapName,
    concept: Annotated[
        str | None, typer.Option(help="Only this concept and those below it: Room, Door, ...")
    ] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show what is on a map: rooms, doors, storeys."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.instances import list_instances  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415

    rows: list[dict[str, object]] = []
    with database(dsn, name) as opened, one_transaction(opened, "semap_read") as connection:
        get_map(connection, name)
        after = 0
        while page := list_instances(
            connection, map_name=name, concept_name=concept, after=after, limit=1000
        ):
            rows += [
                {"id": found.instance_id, "concept": found.concept, "name": found.name,
                 "alias": found.alias, "storey": found.storey}
                for found in page
            ]  # fmt: skip
            after = page[-1].instance_id
    print_rows(rows, as_json, f"Map {name} is empty.")


def create(name: MapName, cell: Cell = 4.0, dsn: Dsn = None) -> None:
    """Make an empty map, with its query track_in_room and its rule room_visits."""
    from semap.store.map.maps import create_map  # noqa: PLC0415

    with (
        shards.where_made(dsn, name) as opened,
        signed_edit(opened, f"semap map create {name}") as connection,
    ):
        create_map(connection, name, cell)
    say(f"Map {name} made.")


def delete(
    name: MapName,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    dsn: Dsn = None,
) -> None:
    """Delete a map with everything on it: instances, tracks, relations, events."""
    from semap.store.map.maps import delete_map  # noqa: PLC0415
    from semap.store.operate.shards import forget_map  # noqa: PLC0415

    if not yes:
        typer.confirm(f"Delete map {name} with its tracks and events?", abort=True)
    with database(dsn) as directory, database(directory, name) as opened:
        with signed_edit(opened, f"semap map delete {name}") as connection:
            delete_map(connection, name)
        if opened != directory:
            forget_map(directory, name)
    say(f"Map {name} deleted.")
