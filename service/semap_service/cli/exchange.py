"""semap map import, export"""

from __future__ import annotations

from dataclasses import asdict
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.output import counted, print_json, say
from semap_service.cli.session import AsJson, Cell, Dsn, MapName, database, signed_edit

if TYPE_CHECKING:
    from semap.store.map.building import ImportReport

GLB, GEOJSON = ".glb", ".geojson"


class Coordinates(Enum):
    metres = "metres"
    degrees = "degrees"


YAML_FILE = "map.yaml"


def import_file(
    file: Annotated[
        Path,
        typer.Argument(
            help="A map: a folder with map.yaml, a .yaml or a .zip file; or a building: GeoJSON in metres "
            "or degrees (.geojson), IFC (.ifc) or IndoorGML (.gml)."
        ),
    ],
    name: Annotated[
        str | None,
        typer.Option("--map", help="Map to import into. [default: named in the file, else as the file]"),
    ] = None,
    crs: Annotated[
        Coordinates | None,
        typer.Option(
            help="What the coordinates of GeoJSON are. [default: degrees where its `crs` says so, or where "
            "rooms of so many metres would be crumbs]"
        ),
    ] = None,
    cell: Cell = 4.0,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Import a building or a whole map, all or nothing: a bad file changes nothing.

    A building goes into the map of the name, which is made if there is none. A map from YAML becomes a new
    map. A small one, written by hand:

        map: hut

        rooms: {Den: {footprint: [[0, 0], [4, 0], [4, 3], [0, 3]], height_m: 2.5}}
    """
    import tempfile  # noqa: PLC0415

    from semap_service.cli.progress import progress_bar  # noqa: PLC0415
    from semap_service.cli.shards import where_made  # noqa: PLC0415
    from semap_service.exchange.map_file import bring_in, name_of, read_file  # noqa: PLC0415

    with (
        progress_bar("objects read", quiet=as_json) as advance,
        tempfile.TemporaryDirectory(prefix="semap-import-") as scratch,
    ):
        found = read_file(file, advance, Path(scratch), None if crs is None else crs.value)
    with (
        where_made(dsn, name_of(found, name, file.stem)) as opened,
        signed_edit(opened, f"semap map import {file}") as connection,
        progress_bar("objects placed", quiet=as_json) as advance,
    ):
        report = bring_in(connection, found, name, file.stem, cell, advance)
    if as_json:
        print_json(asdict(report))
    else:
        for line in report_lines(report):
            say(line)


def export_file(
    map_name: MapName,
    path: Annotated[
        Path,
        typer.Argument(
            help="Where to: a folder (or a map.yaml in it) for the whole map without loss, .glb for what it "
            "looks like, .geojson for its outlines."
        ),
    ],
    crs: Annotated[
        str | None,
        typer.Option(
            help="For .geojson: a system of the earth, such as EPSG:4326. [default: metres of the map]"
        ),
    ] = None,
    dsn: Dsn = None,
) -> None:
    """Write a map to files.

    semap map export office maps/office      a folder to keep in git, and to import again

    semap map export office office.glb       to look at in any viewer of glTF
    """
    from semap.store.database.connection import one_transaction, see_one_state  # noqa: PLC0415

    suffix = path.suffix.lower()
    if crs is not None and suffix != GEOJSON:
        raise InvalidInput("--crs is for .geojson only", "Leave it out, or export to a .geojson file.")
    if suffix not in ("", ".yaml", ".yml", GLB, GEOJSON) and not path.is_dir():
        raise InvalidInput(
            f"{suffix} is no format that semap writes",
            "Give a folder, a map.yaml, a .glb or a .geojson file.",
            str(path),
        )
    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        see_one_state(connection)
        if suffix == GLB:
            from semap.formats.gltf import write_gltf  # noqa: PLC0415
            from semap.store.exchange.map_export import placed_instances  # noqa: PLC0415

            _write(path, write_gltf(placed_instances(connection, map_name), map_name))
        elif suffix == GEOJSON:
            import json  # noqa: PLC0415

            from semap.store.exchange.map_export import placed_instances  # noqa: PLC0415
            from semap_service.exchange.placed_geojson import placed_geojson  # noqa: PLC0415

            placed = placed_instances(connection, map_name)
            document = placed_geojson(connection, map_name, placed, crs)
            _write(path, (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode())
        else:
            from semap.formats import write_map  # noqa: PLC0415
            from semap.store.exchange.map_export import export_map  # noqa: PLC0415

            if path.name != YAML_FILE and suffix in (".yaml", ".yml"):
                raise InvalidInput(
                    f"a map is written as a folder with a {YAML_FILE}", "Give the folder.", str(path)
                )
            path = write_map(export_map(connection, map_name), path.parent if suffix else path)
    say(f"Map {map_name} written to {path}.")


def report_lines(report: ImportReport) -> list[str]:
    """What an import did, for people."""
    counts = ", ".join(f"{count} {concept}" for concept, count in report.concepts.items())
    lines = [f"Imported into map {report.map}: {counts or 'nothing'}."]
    for rooms, count in report.doors.items():
        lines.append(f"  Doors and openings that join {counted(rooms, 'room')}: {count}")
    lines += [f"  {finding.action}: {finding.subject}: {finding.reason}" for finding in report.findings]
    return lines


def _write(path: Path, data: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    except OSError as error:
        raise InvalidInput(f"{path} cannot be written: {error.strerror}", "Choose another place.") from error
