"""Detectors that were added: models kept in semap's home by name, each with what its file does not tell."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

from semap.cluster.folders import explained_access
from semap.cluster.home import default_home
from semap.errors import Conflict, InvalidInput, NotFound

SAID = "detector.json"
BOXES = "boxes.jpg"
"""What it found when it was added, drawn."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


@dataclass(frozen=True)
class Added:
    """layout, classes  as options say them; None: the model tells"""

    name: str
    model: Path
    layout: str | None
    classes: Path | None

    @property
    def boxes(self) -> Path:
        return self.model.parent / BOXES


def detectors_folder() -> Path:
    return default_home() / "detectors"


def added_detectors() -> list[Added]:
    """By name."""
    found = sorted(detectors_folder().glob(f"*/{SAID}")) if detectors_folder().is_dir() else []
    return [_read(each.parent) for each in found]


def named_detector(name: str) -> Added:
    """raises NotFound where none was added by that name"""
    folder = detectors_folder() / name
    if not NAME.fullmatch(name) or not (folder / SAID).is_file():
        there = ", ".join(each.name for each in added_detectors()) or "none"
        raise NotFound("detector", name, f"There are: {there}. Others: semap detector add FILE.onnx")
    return _read(folder)


def added_as(model: Path) -> Added | None:
    """The detector that is meant where no file is there, and the path ends in the name of one."""
    if model.is_file():
        return None
    try:
        return named_detector(model.name)
    except NotFound:
        return None


def require_free(name: str) -> None:
    """raises InvalidInput for a name that cannot be, Conflict where there is one of that name"""
    if not NAME.fullmatch(name):
        raise InvalidInput(
            f"{name!r} cannot be a name", "Give letters, digits, points, - and _: --name NAME", "--name"
        )
    if (detectors_folder() / name).exists():
        raise Conflict(
            f"there is a detector {name!r}", f"semap detector remove {name}; or name this one: --name NAME"
        )


@contextmanager
def draft(model: Path, classes: Path | None) -> Iterator[Path]:
    """A folder with copies of a model, its weights and its classes, that goes unless it is kept.

    raises  ServerUnavailable where semap's home cannot be used
    """
    with explained_access(default_home()):
        detectors_folder().mkdir(parents=True, exist_ok=True)
        folder = Path(mkdtemp(prefix=".", dir=detectors_folder()))
    folder.chmod(0o755)
    try:
        for each in (model, *_weights(model), *([classes] if classes else [])):
            shutil.copyfile(each, folder / each.name)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def keep(folder: Path, name: str, model: Path, layout: str, classes: Path | None) -> Added:
    """Give a draft its name; raises Conflict where another took it."""
    said = {"model": model.name, "layout": layout, "classes": None if classes is None else classes.name}
    (folder / SAID).write_text(json.dumps(said), encoding="utf-8")
    try:
        folder.rename(detectors_folder() / name)
    except OSError:
        require_free(name)
        raise
    return named_detector(name)


def remove(name: str) -> None:
    """raises NotFound where none was added by that name"""
    shutil.rmtree(named_detector(name).model.parent)


def _weights(model: Path) -> list[Path]:
    """Files beside a model that exporters put weights into."""
    names = (f"{model.name}.data", f"{model.name}_data", f"{model.stem}.data", f"{model.stem}.bin")
    return [each for name in names if (each := model.parent / name).is_file()]


def _read(folder: Path) -> Added:
    said = json.loads((folder / SAID).read_text(encoding="utf-8"))
    classes = said["classes"]
    return Added(folder.name, folder / said["model"], said["layout"], classes and folder / classes)
