"""The name of an uploaded file, whose suffix says its format."""

from __future__ import annotations

from pathlib import PurePath

from fastapi import UploadFile

from semap.errors import InvalidInput

LONGEST_SUFFIX = 12
LONGEST_NAME = 200


def file_name(upload: UploadFile) -> str:
    """The last part of the path that the sender gave.

    raises  InvalidInput for a name that does not say the format
    """
    name = PurePath((upload.filename or "").replace("\x00", "")).name
    suffix = PurePath(name).suffix
    if not suffix[1:].isalnum() or not suffix.isascii() or len(suffix) > LONGEST_SUFFIX:
        raise InvalidInput("a file whose name has no known ending", "Name it as map.zip or office.ifc.")
    return name[-LONGEST_NAME:]
