"""Meshes as files: what a reader gets who asks for glb or ply instead of JSON."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from fastapi import Query, Request, Response

from semap.errors import InvalidInput
from semap.geometry.triangulation import triangulated
from semap.model.building import Mesh
from semap.model.source_geometry import PolygonMesh

MeshFormat = Literal["json", "glb", "ply"]
MEDIA_TYPES: dict[MeshFormat, str] = {
    "json": "application/json",
    "glb": "model/gltf-binary",
    "ply": "model/ply",
}
Format = Annotated[
    MeshFormat | None,
    Query(description="json, or a mesh as glb (y up, as glTF demands) or ply (z up). [default: by Accept]"),
]
Y_UP_T_Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def format_of(request: Request, wanted: MeshFormat | None) -> MeshFormat:
    """What was asked for: by the query, else by the first known type in Accept, else JSON."""
    if wanted is not None:
        return wanted
    for part in request.headers.get("accept", "").split(","):
        for name, media_type in MEDIA_TYPES.items():
            if part.split(";")[0].strip().lower() == media_type:
                return name
    return "json"


def mesh_bytes(shape: object, wanted: MeshFormat) -> bytes:
    """A surface as a file.

    raises  InvalidInput if the shape is no surface
    """
    import trimesh  # noqa: PLC0415  slow to import

    if isinstance(shape, PolygonMesh):
        shape = triangulated(shape)
    if not isinstance(shape, Mesh):
        raise InvalidInput("a shape that is no surface has no mesh", "Ask for ?format=json.", "format")
    made = trimesh.Trimesh(shape.vertices_m, shape.faces, process=False)
    if wanted == "glb":
        made.apply_transform(Y_UP_T_Z_UP)
    data = made.export(file_type=wanted)
    return data.encode() if isinstance(data, str) else bytes(data)


def mesh_response(shape: object, wanted: MeshFormat) -> Response:
    """raises  InvalidInput if the shape is no surface"""
    return Response(mesh_bytes(shape, wanted), media_type=MEDIA_TYPES[wanted], headers={"Vary": "Accept"})
