"""The thin edge to the disk: a file's bytes, or an error that says why not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from semap.errors import InvalidInput, NotFound


def read_bytes(path: Path) -> bytes:
    """All bytes of a file.

    raises  NotFound if there is none, InvalidInput if it cannot be read or is empty
    """
    with _opened(path) as file:
        return file.read()


def read_ends(path: Path, length: int) -> tuple[bytes, bytes]:
    """The first and the last bytes of a file, at most `length` each; errors as in `read_bytes`."""
    with _opened(path) as file:
        head = file.read(length)
        file.seek(-min(length, path.stat().st_size), 2)
        return head, file.read()


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    try:
        with path.open("rb") as file:
            if path.stat().st_size == 0:
                raise InvalidInput("the file is empty", "Export or copy it again.", str(path))
            yield file
    except FileNotFoundError as error:
        raise NotFound("file", path, "Check the path.") from error
    except OSError as error:
        raise InvalidInput(
            f"the file cannot be read: {error.strerror}", "Give a readable file.", str(path)
        ) from error
