"""Whether two files are the same recording, looked at in the same way."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from pathlib import Path

VERSION = 2
"""Of perception: raised when it makes something else of the same recording, so that half of the old and half
of the new never meet in one."""
BLOCK = 1 << 20
ENDINGS = frozenset((".bag", ".mcap", ".db3", ".yaml", ".zstd"))
"""Of the files in a folder that are the recording; a reader of SQLite leaves others beside them."""


def fingerprint(path: Path | None, models: Iterable[Path], options: tuple[object, ...]) -> str:
    """SHA-256 over all that determines the results: the files' bytes, the models', options and version.

    What files are called does not matter.
    """
    digest = hashlib.sha256(repr((VERSION, options)).encode())
    for file in (*(() if path is None else _files(path)), *models):
        digest.update(f"{file.stat().st_size},".encode())
        with file.open("rb") as opened:
            while block := opened.read(BLOCK):
                digest.update(block)
    return digest.hexdigest()


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from sorted(file for file in path.rglob("*") if file.suffix in ENDINGS and file.is_file())
    else:
        yield path
