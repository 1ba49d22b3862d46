"""Polygon meshes as PostGIS stores them: POLYHEDRALSURFACE Z in extended well-known binary (EWKB).

Layout as in `semap.geometry.tin`; each patch is a Polygon Z of one closed ring.
"""

from __future__ import annotations

import struct

import numpy as np

from semap.errors import InvalidInput
from semap.geometry.tin import HAS_SRID, HAS_Z, LITTLE_ENDIAN, merge_points
from semap.model.source_geometry import PolygonMesh

POLYHEDRAL_SURFACE = 15
POLYGON = 3


def polygon_mesh_to_wkb(mesh: PolygonMesh) -> bytes:
    """The mesh as little-endian EWKB of a POLYHEDRALSURFACE Z without SRID; faces keep order and winding."""
    parts = [struct.pack("<BII", LITTLE_ENDIAN, POLYHEDRAL_SURFACE | HAS_Z, len(mesh.faces))]
    for face in mesh.faces:
        ring_m = np.ascontiguousarray(mesh.vertices_m[[*face, face[0]]], dtype="<f8")
        parts.append(struct.pack("<BIII", LITTLE_ENDIAN, POLYGON | HAS_Z, 1, len(ring_m)))
        parts.append(ring_m.tobytes())
    return b"".join(parts)


def polygon_mesh_from_wkb(wkb: bytes) -> PolygonMesh:
    """The mesh of a POLYHEDRALSURFACE Z, its equal vertices merged; faces keep order and winding.

    wkb     little-endian EWKB, with or without SRID
    raises  InvalidInput if the bytes are anything else, or a face has holes
    """
    try:
        order, kind = struct.unpack_from("<BI", wkb)
        place = 9 if kind & HAS_SRID else 5
        if order != LITTLE_ENDIAN or kind & ~HAS_SRID != POLYHEDRAL_SURFACE | HAS_Z:
            raise _no_surface(f"byte order {order}, type {kind:#x}")
        (count,) = struct.unpack_from("<I", wkb, place)
        place += 4
        rings = []
        for _ in range(count):
            order, kind, ring_count, length = struct.unpack_from("<BIII", wkb, place)
            if order != LITTLE_ENDIAN or kind != POLYGON | HAS_Z or ring_count != 1 or length < 4:
                raise _no_surface("a face is not a polygon of one closed ring")
            rings.append(np.frombuffer(wkb, "<f8", 3 * length, place + 13).reshape(-1, 3)[:-1])
            place += 13 + 24 * length
    except (struct.error, ValueError) as error:
        raise _no_surface("the bytes end too early") from error
    if place != len(wkb):
        raise _no_surface("there are more bytes than faces")
    vertices_m, indices = merge_points(np.concatenate(rings) if rings else np.empty((0, 3)))
    ends = np.cumsum([len(ring) for ring in rings], dtype=np.int64)[:-1]
    return PolygonMesh(
        vertices_m, tuple(tuple(face.tolist()) for face in np.split(indices, ends) if len(face))
    )


def _no_surface(reason: str) -> InvalidInput:
    return InvalidInput(f"not a POLYHEDRALSURFACE Z in EWKB: {reason}", "Read the geometry with ST_AsEWKB.")
