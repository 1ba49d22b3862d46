"""This machine: space on its disks, and what of semap is installed."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from semap.cluster import default_home
from semap.store.operate.doctor.finding import MachineCheck, Trouble, mebibytes, warn, wrong
from semap_service.http.page import FILES, INDEX

TIGHT_BYTES = 5 * 1024**3
FULL_BYTES = 1024**3

EXTRAS = (
    ("ifc", ("ifcopenshell",), "IFC files cannot be imported"),
    ("parquet", ("pyarrow",), "Parquet files can be neither read nor written"),
    ("perception", ("onnxruntime", "cv2", "rosbags"), "recordings of sensors cannot be ingested"),
    ("plot", ("matplotlib",), "nothing can be drawn as a picture"),
)
"""Module names by extra, and what is not to be had without."""


def _disk() -> Iterator[Trouble]:
    for what, folder in (("semap's data", default_home()), ("files that pass", Path(tempfile.gettempdir()))):
        there = next((each for each in (folder, *folder.parents) if each.is_dir()), Path("/"))
        free = shutil.disk_usage(there).free
        if free < TIGHT_BYTES:
            say = wrong if free < FULL_BYTES else warn
            yield say(
                f"{mebibytes(free)} are free for {what} ({there})",
                "Free some space, or set SEMAP_HOME (TMPDIR) to a folder on a larger disk.",
            )


def _page() -> Iterator[Trouble]:
    if not (FILES / INDEX).is_file():
        yield warn(
            "the page is not built, so that browsers see only a word on that",
            "In a checkout: ./dev page (needs Node 20); an installed semap has it.",
        )


def _extras() -> Iterator[Trouble]:
    for extra, modules, lack in EXTRAS:
        if missing := [module for module in modules if find_spec(module) is None]:
            yield warn(f"without {', '.join(missing)} {lack}", f"pip install 'semap[{extra}]'")


MACHINE_CHECKS = (
    MachineCheck("disk", "there is space on the disks", _disk),
    MachineCheck("page", "the page is built", _page),
    MachineCheck("extras", "all that reads and draws files is installed", _extras),
)
