"""Whether two files are the same recording, looked at in the same way."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

VERSION = 1
"""Of perception: raised when it makes something else of the same recording, so that half of the old and half
of the new never meet in one."""
BLOCK = 1 << 20


def fingerprint(path: Path, image_model: Path | None, options: tuple[object, ...]) -> str:
    """SHA-256 over all that determines the results: the files' bytes, the model's, options and version."""
    digest = hashlib.sha256(repr((VERSION, options)).encode())
    for file in (*_files(path), *([] if image_model is None else [image_model])):
        digest.update(file.name.encode())
        with file.open("rb") as opened:
            while block := opened.read(BLOCK):
                digest.update(block)
    return digest.hexdigest()


def _files(path: Path) -> Iterator[Path]:
    if path.is_dir():
        yield from sorted(file for file in path.rglob("*") if file.is_file())
    else:
        yield path
