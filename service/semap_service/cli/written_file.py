"""A file that a command writes: whole, or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from semap.errors import InvalidInput


@contextmanager
def written(file: Path) -> Iterator[Path]:
    """A file beside it that takes its place once it is whole.

    raises InvalidInput where it cannot be written
    """
    try:
        handle, name = tempfile.mkstemp(suffix=file.suffix, prefix=f".{file.stem}-", dir=file.parent)
    except OSError as error:
        raise InvalidInput(f"{file} cannot be written: {error.strerror}", "Check the folder.") from error
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        draft.chmod(0o644)
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
