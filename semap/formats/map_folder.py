"""The folder of a map: what may be read in it, and how what is written there is named."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from semap.errors import TooLarge
from semap.formats.source import read_bytes
from semap.formats.yaml_node import Node

MAX_FILE_BYTES = 256 * 1024**2


def read_inside(folder: Path, node: Node) -> tuple[bytes, str]:
    """The bytes and the suffix of the file that a node names.

    raises  InvalidInput if the path leaves the folder, NotFound, TooLarge
    """
    path = inside(folder, node)
    if path.is_file() and path.stat().st_size > MAX_FILE_BYTES:
        raise TooLarge(f"{node.where}: {node.source} is larger than {MAX_FILE_BYTES} bytes.", "Simplify it.")
    return read_bytes(path), path.suffix.lower()


def inside(folder: Path, node: Node) -> Path:
    """The path of a file in the folder; links count as what they point to.

    raises  InvalidInput if it leaves the folder
    """
    text = node.text()
    parts = PurePosixPath(text)
    if len(text) > 1000 or any(len(part.encode()) > 255 for part in parts.parts):
        raise node.wrong("the path is longer than a file's can be", "Name a file beside map.yaml.")
    leaves = parts.is_absolute() or ".." in parts.parts or "\\" in text or ":" in text or "\0" in text
    if leaves or not (folder / text).resolve().is_relative_to(folder.resolve()):
        raise node.wrong(
            f"the path {text!r} leaves the folder of the map",
            "Copy the file beside map.yaml and name it relative to it, with forward slashes.",
        )
    return folder / text


def file_names(keys: Iterable[str], suffix: str) -> dict[str, str]:
    """A file name for each key, told apart also where upper and lower case count the same."""
    names: dict[str, str] = {}
    used: set[str] = set()
    for key in keys:
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", key).strip("_")[:60] or "part"
        name, number = stem, 2
        while name.casefold() in used:
            name, number = f"{stem}-{number}", number + 1
        used.add(name.casefold())
        names[key] = name + suffix
    return names


def replace_file(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees the old one or the new one, never half of it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{os.getpid()}")
    draft.write_bytes(content)
    draft.replace(path)
