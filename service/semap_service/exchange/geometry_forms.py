"""A geometry of a description in each form in which a reader may have got it: JSON, or a mesh as a file."""

from __future__ import annotations

from collections.abc import Callable

from sqlalchemy import Connection

from semap.errors import NotFound
from semap.model.source_geometry import SourceGeometry
from semap.store import blueprints
from semap_service.documents.geometry import geometry_document
from semap_service.documents.shape import fits_json
from semap_service.exchange.mesh_response import mesh_bytes
from semap_service.http.etag import Representation


def find_geometry(connection: Connection, description_id: int, name: str) -> SourceGeometry:
    for each in blueprints.geometries_of(connection, description_id):
        if each.name == name:
            return each
    raise NotFound("geometry", name, f"The description {description_id} says what geometries it has.")


def geometry_forms(
    description_id: int, name: str
) -> Callable[[Connection], tuple[Callable[[], Representation], ...]]:
    """The geometry in each form in which a reader may have got it."""

    def current(connection: Connection) -> tuple[Callable[[], Representation], ...]:
        found = find_geometry(connection, description_id, name)
        as_json = (lambda: geometry_document(found),) if fits_json(found.shape) else ()
        if found.type not in ("TRIANGLEMESH3D", "POLYGONMESH3D"):
            return as_json
        as_files = (lambda: mesh_bytes(found.shape, "glb"), lambda: mesh_bytes(found.shape, "ply"))
        return (*as_json, *as_files)

    return current
