"""Triangle meshes as PostGIS stores them: TIN Z in extended well-known binary (EWKB).

Layout: https://libgeos.org/specifications/wkb/ (the Z flag of EWKB), TIN = 16 and Triangle = 17 of
OGC 06-103r4. Every triangle is a record of the same size, so that numpy reads and writes all at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.model.building import Mesh

HAS_Z = 0x80000000
HAS_SRID = 0x20000000
TIN = 16
TRIANGLE = 17
LITTLE_ENDIAN = 1

HEADER = np.dtype([("order", "u1"), ("type", "<u4")])
RECORD = np.dtype(
    [("order", "u1"), ("type", "<u4"), ("rings", "<u4"), ("points", "<u4"), ("ring_m", "<f8", (4, 3))]
)


def mesh_to_wkb(mesh: Mesh) -> bytes:
    """The mesh as little-endian EWKB of a TIN Z without SRID; face order and winding are kept."""
    records = np.empty(len(mesh.faces), dtype=RECORD)
    records["order"] = LITTLE_ENDIAN
    records["type"] = TRIANGLE | HAS_Z
    records["rings"] = 1
    records["points"] = 4
    records["ring_m"] = mesh.vertices_m[mesh.faces[:, [0, 1, 2, 0]]]
    header = np.array([(LITTLE_ENDIAN, TIN | HAS_Z)], dtype=HEADER)
    return header.tobytes() + np.array([len(records)], dtype="<u4").tobytes() + records.tobytes()


def mesh_from_wkb(wkb: bytes) -> Mesh:
    """The mesh of a TIN Z, its equal vertices merged; face order and winding are kept.

    wkb     little-endian EWKB, with or without SRID
    raises  InvalidInput if the bytes are anything else
    """
    records = _records(wkb)
    corners = records["ring_m"][:, :3].reshape(-1, 3)
    vertices, indices = merge_points(corners)
    return Mesh(vertices, indices.reshape(-1, 3))


def merge_points(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The distinct points in lexical order, and for each given point its index among them.

    points  (n, d)
    """
    # np.unique(axis=0) compares whole rows as bytes, which takes several times as long.
    order = np.lexsort(points.T[::-1])
    ordered = points[order]
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    indices = np.empty(len(points), dtype=np.int64)
    indices[order] = np.cumsum(is_new) - 1
    return ordered[is_new], indices


def _records(wkb: bytes) -> NDArray[np.void]:
    try:
        header = np.frombuffer(wkb, dtype=HEADER, count=1)[0]
        kind = int(header["type"])
        start = HEADER.itemsize + (4 if kind & HAS_SRID else 0)
        count = int(np.frombuffer(wkb, dtype="<u4", count=1, offset=start)[0])
        records = np.frombuffer(wkb, dtype=RECORD, offset=start + 4)
    except ValueError as error:
        raise _not_a_tin("the bytes end too early") from error
    if int(header["order"]) != LITTLE_ENDIAN or kind & ~HAS_SRID != TIN | HAS_Z:
        raise _not_a_tin(f"byte order {header['order']}, type {kind:#x}")
    if len(records) != count:
        raise _not_a_tin(f"{count} triangles announced, {len(records)} found")
    is_triangle = (
        (records["order"] == LITTLE_ENDIAN)
        & (records["type"] == TRIANGLE | HAS_Z)
        & (records["rings"] == 1)
        & (records["points"] == 4)
    )
    if not is_triangle.all():
        raise _not_a_tin(f"part {int(np.argmin(is_triangle))} is not a triangle of one closed ring")
    return records


def _not_a_tin(reason: str) -> InvalidInput:
    return InvalidInput(f"not a TIN Z in EWKB: {reason}", "Read the geometry with ST_AsEWKB.")
