"""Shapes as PostGIS stores them, in extended well-known binary (EWKB) without SRID."""

from __future__ import annotations

import struct

import shapely

from semap.errors import InvalidInput
from semap.geometry.polyhedral_surface import POLYHEDRAL_SURFACE, polygon_mesh_from_wkb, polygon_mesh_to_wkb
from semap.geometry.tin import TIN, mesh_from_wkb, mesh_to_wkb
from semap.model.building import Mesh
from semap.model.source_geometry import PolygonMesh

TYPE_MASK = 0x0FFFFFFF


def to_ewkb(shape: shapely.Geometry | Mesh | PolygonMesh) -> bytes:
    """A mesh as TIN Z, a polygon mesh as POLYHEDRALSURFACE Z, any other as it is."""
    if isinstance(shape, Mesh):
        return mesh_to_wkb(shape)
    if isinstance(shape, PolygonMesh):
        return polygon_mesh_to_wkb(shape)
    return bytes(shapely.to_wkb(shape))


def from_ewkb(wkb: bytes) -> shapely.Geometry | Mesh | PolygonMesh:
    """The shape that `to_ewkb` wrote, or that ST_AsEWKB gives.

    raises  InvalidInput if the bytes are none
    """
    kind = struct.unpack_from("<I", wkb, 1)[0] & TYPE_MASK if len(wkb) >= 5 else 0
    if kind == TIN:
        return mesh_from_wkb(wkb)
    if kind == POLYHEDRAL_SURFACE:
        return polygon_mesh_from_wkb(wkb)
    try:
        return shapely.from_wkb(wkb)
    except shapely.errors.GEOSException as error:
        raise InvalidInput(f"not a geometry in EWKB: {error}", "Read it with ST_AsEWKB.") from error
