"""Meshes in PLY as semap keeps them beside a map: binary, float64, nothing merged and nothing turned.

Any program reads these files. A PLY file of another program goes through `semap.formats.mesh_file`.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.model.building import Mesh
from semap.model.source_geometry import PolygonMesh

COMMENT = "written by semap"
HEADER = re.compile(
    rb"ply\nformat binary_little_endian 1\.0\ncomment " + COMMENT.encode() + rb"\n"
    rb"element vertex (\d{1,10})\nproperty double x\nproperty double y\nproperty double z\n"
    rb"element face (\d{1,10})\nproperty list (uchar|uint) int vertex_indices\nend_header\n"
)
TRIANGLE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write_ply(mesh: Mesh | PolygonMesh) -> bytes:
    """The mesh with its vertices, faces and their order as they are."""
    if isinstance(mesh, Mesh):
        count_type = "uchar"
        records = np.empty(len(mesh.faces), dtype=TRIANGLE)
        records["count"], records["corners"] = 3, mesh.faces
        faces = records.tobytes()
    else:
        count_type = "uchar" if all(len(face) < 256 for face in mesh.faces) else "uint"
        dtype = "<u1" if count_type == "uchar" else "<u4"
        faces = b"".join(
            np.array(len(face), dtype=dtype).tobytes() + np.array(face, dtype="<i4").tobytes()
            for face in mesh.faces
        )
    header = (
        f"ply\nformat binary_little_endian 1.0\ncomment {COMMENT}\n"
        f"element vertex {len(mesh.vertices_m)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(mesh.faces)}\nproperty list {count_type} int vertex_indices\nend_header\n"
    )
    return header.encode() + np.ascontiguousarray(mesh.vertices_m, dtype="<f8").tobytes() + faces


def is_own_ply(data: bytes) -> bool:
    """Whether `write_ply` wrote these bytes."""
    return HEADER.match(data) is not None


def read_ply(data: bytes, where: str = "") -> Mesh:
    """The triangles that `write_ply` wrote, bit by bit.

    raises  InvalidInput if the bytes are anything else, or a face names a vertex that is not there
    """
    vertices_m, rest, count, _ = _vertices(data, where)
    if len(rest) != count * TRIANGLE.itemsize:
        raise _bad("its faces are no triangles, or are cut off", where)
    records = np.frombuffer(rest, dtype=TRIANGLE)
    if (records["count"] != 3).any():
        raise _bad("a face is no triangle", where)
    faces = records["corners"].astype(np.int64)
    _require_known(faces.ravel(), len(vertices_m), where)
    return Mesh(vertices_m, faces)


def read_polygon_ply(data: bytes, where: str = "") -> PolygonMesh:
    """The polygons that `write_ply` wrote; errors as in `read_ply`."""
    vertices_m, rest, count, dtype = _vertices(data, where)
    faces: list[tuple[int, ...]] = []
    place, size = 0, np.dtype(dtype).itemsize
    try:
        for _ in range(count):
            length = int(np.frombuffer(rest, dtype, 1, place)[0])
            corners = np.frombuffer(rest, "<i4", length, place + size) if length else np.empty(0, np.int32)
            faces.append(tuple(corners.tolist()))
            place += size + 4 * length
    except ValueError as error:
        raise _bad("its faces are cut off", where) from error
    if place != len(rest):
        raise _bad("there are more bytes than faces", where)
    used = [corner for face in faces for corner in face]
    _require_known(np.array(used, dtype=np.int64), len(vertices_m), where)
    return PolygonMesh(vertices_m, tuple(faces))


def _vertices(data: bytes, where: str) -> tuple[NDArray[np.float64], bytes, int, str]:
    """Vertices, the bytes of the faces, how many there are, and the type of their lengths."""
    header = HEADER.match(data)
    if header is None:
        raise _bad("it was not written by semap", where)
    start, length = header.end(), 24 * int(header[1])
    if len(data) < start + length:
        raise _bad("its vertices are cut off", where)
    vertices_m = np.frombuffer(data, "<f8", 3 * int(header[1]), start).reshape(-1, 3).astype(np.float64)
    if not np.isfinite(vertices_m).all():
        raise _bad("a vertex is not finite", where)
    return vertices_m, data[start + length :], int(header[2]), "<u1" if header[3] == b"uchar" else "<u4"


def _require_known(corners: NDArray[np.int64], count: int, where: str) -> None:
    if len(corners) and (corners.min() < 0 or corners.max() >= count):
        raise _bad("a face names a vertex that is not there", where)


def _bad(reason: str, where: str) -> InvalidInput:
    return InvalidInput(f"the mesh cannot be read: {reason}", "Export the map again.", where)
