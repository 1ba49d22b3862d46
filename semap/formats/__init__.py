"""Reading of map files: each format's parser gives a `Building` or a `Mesh`, and says what it repaired.

`read_*(path)` is the thin edge that touches the disk; what parses is a pure function of the content.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from semap.errors import InvalidInput
from semap.formats.geojson import read_geojson
from semap.formats.ifc import read_ifc
from semap.model.building import Building

__all__ = ["read_building"]


def read_building(path: Path, progress: Callable[[int, int], None] | None = None) -> Building:
    """Read a building, choosing the format by the file's suffix (.geojson, .json or .ifc).

    progress  called with the number of objects done and their total, where the format is slow to read
    raises    InvalidInput if the suffix is another or the file is bad; NotFound if there is no such file
    """
    suffix = path.suffix.lower()
    if suffix in {".geojson", ".json"}:
        return read_geojson(path)
    if suffix == ".ifc":
        return read_ifc(path, progress)
    raise InvalidInput(
        f"{suffix or 'a file without suffix'} is no building format that semap reads",
        "Give a .geojson, .json or .ifc file.",
        str(path),
    )
