"""The thin edge to the disk: a file's bytes, or an error that says why not."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from semap.errors import InvalidInput, NotFound

TO_UTF8 = "Save it as UTF-8, for example with `iconv -f {} -t UTF-8`."
ASCII = [bytes([each]) for each in (9, 10, 13, *range(32, 127))]
# By a byte order mark, or a first character of ASCII; UTF-32 first, as it begins like UTF-16.
WIDE = {
    "UTF-32": (
        b"\xff\xfe\0\0",
        b"\0\0\xfe\xff",
        *(each + b"\0\0\0" for each in ASCII),
        *(b"\0\0\0" + each for each in ASCII),
    ),
    "UTF-16": (
        b"\xff\xfe",
        b"\xfe\xff",
        *(each + b"\0" for each in ASCII),
        *(b"\0" + each for each in ASCII),
    ),
}


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


def utf8(data: bytes, where: str) -> str:
    """The text of a file in UTF-8.

    raises  InvalidInput if it is in another encoding, which is named where that can be told
    """
    refuse_utf16(data, where)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InvalidInput("this is not UTF-8", TO_UTF8.format("LATIN1"), f"{where}:{line}") from error


def refuse_utf16(head: bytes, where: str) -> None:
    """raises  InvalidInput if a file that begins so is UTF-16 or UTF-32"""
    for name, marks in WIDE.items():
        if head.startswith(marks):
            raise InvalidInput(f"this file is {name}, and UTF-8 is needed", TO_UTF8.format(name), where)


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
