"""semap map"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from semap_service.cli.output import counted, print_json, print_rows
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from semap.store.building import ImportReport

MapName = Annotated[str, typer.Argument(metavar="MAP", help="Name of the map.")]
Cell = Annotated[
    float,
    typer.Option(
        help="Side of the cells of the spatial index [m]: 4 for a building, 100 for a farm.", min=0.1
    ),
]


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Maps: import a building, list what is there, delete.")
    app.command("import")(import_file)
    app.command("list")(list_all)
    app.command("show")(show)
    app.command("create")(create)
    app.command("delete")(delete)
    return app


def import_file(
    file: Annotated[Path, typer.Argument(help="A building: GeoJSON in metres (.geojson) or IFC (.ifc).")],
    name: Annotated[
        str | None, typer.Option("--map", help="The map to import into. [default: the file's name]")
    ] = None,
    cell: Cell = 4.0,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Bring a building into a map, which is made if there is none of that name.

    All of it or nothing: a file that cannot be imported changes nothing.
    """
    from semap.formats import read_building  # noqa: PLC0415
    from semap.store.building import import_building  # noqa: PLC0415
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.maps import create_map, list_maps  # noqa: PLC0415
    from semap_service.cli.progress import progress_bar  # noqa: PLC0415

    map_name = name or file.stem
    with progress_bar("objects read", quiet=as_json) as advance:
        building = read_building(file, advance)
    with (
        database(dsn) as opened,
        one_transaction(opened, "semap_api") as connection,
        progress_bar("objects placed", quiet=as_json) as advance,
    ):
        if map_name not in {found.name for found in list_maps(connection)}:
            create_map(connection, map_name, cell)
        report = import_building(connection, map_name, building, advance)
    if as_json:
        print_json(asdict(report))
    else:
        for line in report_lines(report):
            typer.echo(line)


def report_lines(report: ImportReport) -> list[str]:
    """What an import did, for people."""
    counts = ", ".join(f"{count} {concept}" for concept, count in report.concepts.items())
    lines = [f"Imported into map {report.map}: {counts}."]
    for rooms, count in report.doors.items():
        lines.append(f"  Doors and openings that join {counted(rooms, 'room')}: {count}")
    lines += [f"  {finding.action}: {finding.subject}: {finding.reason}" for finding in report.findings]
    return lines


def list_all(as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the maps."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.maps import list_maps  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        rows = [asdict(found) for found in list_maps(connection)]
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
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.instances import list_instances  # noqa: PLC0415
    from semap.store.maps import get_map  # noqa: PLC0415

    rows: list[dict[str, object]] = []
    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
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
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.maps import create_map  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        create_map(connection, name, cell)
    typer.echo(f"Map {name} made.")


def delete(
    name: MapName,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    dsn: Dsn = None,
) -> None:
    """Delete a map with everything on it: instances, tracks, relations, events."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.maps import delete_map  # noqa: PLC0415

    if not yes:
        typer.confirm(f"Delete map {name} with its tracks and events?", abort=True)
    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        delete_map(connection, name)
    typer.echo(f"Map {name} deleted.")
