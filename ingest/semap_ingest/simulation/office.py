"""A recording of the simulated office with labels and map, written into a folder or found in the cache."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path

from semap.errors import Conflict, InvalidInput
from semap_ingest.simulation.labels import write_labels
from semap_ingest.simulation.map_folder import write_map
from semap_ingest.simulation.schedule import moments
from semap_ingest.simulation.settings import OfficeSettings

SIMULATOR = 1
"""Raise it when the same settings give another recording: what lies in caches is then made anew."""

Advance = Callable[[int, int], None]
"""Called with the tenths of a second written and those there are in all."""


@dataclass(frozen=True)
class OfficePaths:
    """recording  an MCAP file; labels  JSON, see `labels`; map  a map.yaml with meshes beside it"""

    recording: Path
    labels: Path
    map: Path

    @classmethod
    def inside(cls, folder: Path) -> OfficePaths:
        return cls(folder / "recording.mcap", folder / "labels.json", folder / "map" / "map.yaml")


def write_office(
    folder: Path, settings: OfficeSettings, advance: Advance = lambda done, total: None
) -> OfficePaths:
    """Write a recording, its labels and its map into a new folder, which appears when all of it is there.

    raises  Conflict if there is something already
            InvalidInput where no schedule was found for these settings, or where a package is missing
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise Conflict(f"{folder} is there already.", "Name a new folder, or remove that one.")
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as unfinished:
        whole = Path(unfinished) / "office"
        whole.mkdir()
        _write(OfficePaths.inside(whole), settings, advance)
        try:
            whole.replace(folder)
        except OSError as error:
            raise Conflict(
                f"{folder} was written by somebody else meanwhile.", "Name a new folder, or use that one."
            ) from error
    return OfficePaths.inside(folder)


def office_recording(settings: OfficeSettings, advance: Advance = lambda done, total: None) -> OfficePaths:
    """The recording of these settings from the user's cache, written there at first use.

    Two processes may ask at once: each writes on its own, and the first that is ready is kept.
    """
    text = json.dumps({"simulator": SIMULATOR, **asdict(settings)}, sort_keys=True)
    name = f"office-{settings.seed}-{sha256(text.encode()).hexdigest()[:12]}"
    folder = _cache_folder() / name
    if not folder.exists():
        try:
            return write_office(folder, settings, advance)
        except Conflict:
            if not OfficePaths.inside(folder).labels.exists():
                raise
    return OfficePaths.inside(folder)


def _write(paths: OfficePaths, settings: OfficeSettings, advance: Advance) -> None:
    try:
        from semap_ingest.simulation.recording_writing import write_recording  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise InvalidInput(
            f"simulating a recording needs {error.name}", "pip install 'semap[perception]'"
        ) from error
    write_labels(paths.labels, write_recording(paths.recording, settings, moments(settings), advance))
    write_map(paths.map.parent)


def _cache_folder() -> Path:
    """As the XDG base directory specification says."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(named) if Path(named).is_absolute() else Path.home() / ".cache") / "semap"
