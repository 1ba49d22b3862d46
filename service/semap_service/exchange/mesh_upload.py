"""Uploaded meshes: their options, and what is said about them."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Form

from semap.formats.mesh_file import MeshFile, read_mesh_file
from semap_service.documents.geometry import FindingDocument
from semap_service.http.body_limit import LIMIT_BYTES

Unit = Annotated[
    Literal["file", "m", "cm", "mm", "inch", "foot"] | None,
    Form(description="The unit of the file's lengths. [default: of the format or file, else metres]"),
]
UpAxis = Annotated[
    Literal["x", "y", "z"] | None,
    Form(description="The axis of the file that points up. [default: of the format or file, else z]"),
]


def read_upload(data: bytes, suffix: str, unit: str | None, up: str | None) -> MeshFile:
    """The mesh of an uploaded file, by its suffix.

    raises  TooLarge, InvalidInput
    """
    return read_mesh_file(data, suffix, unit=unit or "file", up=up, max_bytes=LIMIT_BYTES)


def findings(read: MeshFile) -> list[FindingDocument]:
    return [FindingDocument.model_validate(each) for each in read.findings]
