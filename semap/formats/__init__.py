"""Reading and writing of map files: each format's parser gives a value, and says what it repaired.

`read_*(path)` is the thin edge that touches the disk; what parses is a pure function of the content.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from shapely.errors import GEOSException

from semap.errors import InvalidInput
from semap.formats.geojson import read_geojson
from semap.formats.geojson_system import Crs
from semap.formats.ifc import read_ifc
from semap.formats.indoorgml import read_indoorgml
from semap.formats.validation import doubts, refuse_unusable
from semap.formats.yaml_map import read_map, write_map
from semap.model.building import Building

__all__ = ["read_building", "read_map", "write_map"]


def read_building(
    path: Path, progress: Callable[[int, int], None] | None = None, crs: Crs | None = None
) -> Building:
    """Read a building, choosing the format by the file's suffix, and look for what is doubtful in it.

    path      .geojson or .json, .ifc, .gml or .indoorgml
    progress  called with the number of objects done and their total, where the format is slow to read
    crs       what the coordinates of GeoJSON are; None: as the file shows
    raises    InvalidInput if the suffix is another, the file is bad, or something lies where nothing can;
              NotFound if there is no such file
    """
    try:
        building = _read(path, progress, crs)
        refuse_unusable(building, str(path))
        return replace(building, findings=(*building.findings, *doubts(building)))
    except GEOSException as error:
        raise InvalidInput(
            f"a shape that geometry cannot work with: {error}", "Look for extreme coordinates.", str(path)
        ) from error


def _read(path: Path, progress: Callable[[int, int], None] | None, crs: Crs | None) -> Building:
    suffix = path.suffix.lower()
    if suffix in {".geojson", ".json"}:
        return read_geojson(path, crs)
    if crs is not None:
        raise InvalidInput("what its coordinates are was said", "That is for GeoJSON only.", str(path))
    if suffix == ".ifc":
        return read_ifc(path, progress)
    if suffix in {".gml", ".indoorgml"}:
        return read_indoorgml(path)
    raise InvalidInput(
        f"{suffix or 'a file without suffix'} is no building format that semap reads",
        "Give a .geojson, .json, .ifc, .gml or .indoorgml file; a map in YAML is read as a map.",
        str(path),
    )
