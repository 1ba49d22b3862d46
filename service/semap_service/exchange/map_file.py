"""Files of whole maps, brought into the database: for the service and for the command line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from sqlalchemy import Connection

from semap.errors import InvalidInput, NotFound
from semap.formats import read_building, read_map
from semap.formats.geojson_system import Crs
from semap.formats.uncollected import uncollected
from semap.model.building import Building
from semap.model.map_document import MapDocument
from semap.rules.language.reading import parse_declaration
from semap.store.exchange.map_import import import_map
from semap.store.map.building import DOOR, ImportReport, import_building
from semap.store.map.maps import create_map, list_maps
from semap_service.exchange.zip_archive import unpack

MAP_FILE = "map.yaml"
MAP_SUFFIXES = (".yaml", ".yml", ".zip")

Progress = Callable[[int, int], None]


def read_file(
    path: Path, progress: Progress | None = None, scratch: Path | None = None, crs: Crs | None = None
) -> MapDocument | Building:
    """A map (a folder, .yaml or .zip) or a building (.geojson, .ifc, .gml, ...) by its suffix.

    scratch  an empty folder to unpack a .zip into; without one a .zip is refused
    crs      what the coordinates of GeoJSON are; None: as the file shows
    raises   NotFound, TooLarge, InvalidInput
    """
    if path.suffix.lower() == ".zip":
        if scratch is None:
            raise InvalidInput("a .zip file", "Unpack it, and give the folder.", str(path))
        if not path.is_file():
            raise NotFound("file", path, "Check the path.")
        unpack(path, scratch)
        path = _folder_of_map(scratch)
    if path.is_dir() or path.suffix.lower() in MAP_SUFFIXES:
        return read_map(path)
    return read_building(path, progress, crs)


def name_of(found: MapDocument | Building, name: str | None, default_name: str) -> str:
    """What the map will be called; as `bring_in`."""
    own_name = found.name if isinstance(found, MapDocument) else default_name
    wanted = own_name if name is None else name
    if not wanted:
        raise InvalidInput("a map without a name", "Give it one.", "name")
    if "/" in wanted:
        raise InvalidInput(f"a map named {wanted!r}", "Choose a name without a slash.", "name")
    return wanted


def bring_in(
    connection: Connection,
    found: MapDocument | Building,
    name: str | None,
    default_name: str,
    cell_m: float = 4.0,
    progress: Progress | None = None,
) -> ImportReport:
    """Bring what was read into the database: a map as a new one, a building into a map that may exist.

    name          of the map; None: what a map calls itself, or the default
    raises        Conflict, InvalidInput
    """
    wanted = name_of(found, name, default_name)
    if isinstance(found, MapDocument):
        document = replace(found, name=wanted)
        _require_rules(document)
        notes = import_map(connection, document)
        concepts = Counter(each.concept for each in document.instances)
        doors = Counter(len(each.joins) for each in document.instances if each.concept == DOOR or each.joins)
        return ImportReport(document.name, dict(sorted(concepts.items())), dict(sorted(doors.items())), notes)
    if wanted not in {known.name for known in list_maps(connection)}:
        create_map(connection, wanted, cell_m)
    with uncollected():
        return import_building(connection, wanted, found, progress)


def _require_rules(document: MapDocument) -> None:
    """raises InvalidInput for a rule that would never be in force"""
    known = {each.name for each in document.queries}
    for each in document.rules:
        declaration = parse_declaration({"name": each.name, **each.declaration}, each.name)
        read = {
            i.name for i in declaration.inputs if i.kind == "query" or (i.kind is None and i.name in known)
        }
        if read != set(each.queries):
            raise InvalidInput(
                f"the inputs that are queries are {sorted(read)}, and the queries {sorted(each.queries)}",
                "Let them agree.",
                each.name,
            )


def _folder_of_map(folder: Path) -> Path:
    """The folder with the map's file: this one, or the only one in it."""
    if (folder / MAP_FILE).is_file():
        return folder
    inner = [each for each in folder.iterdir() if (each / MAP_FILE).is_file()]
    if len(inner) != 1:
        raise NotFound("file", MAP_FILE, "Zip the folder of the map, with its map.yaml at the top.")
    return inner[0]
