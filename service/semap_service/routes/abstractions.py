"""What is derived from shapes: boxes, hulls, outlines, positions and regions of descriptions and instances"""

from __future__ import annotations

from typing import Annotated, TypeGuard, cast, get_args

import shapely
from fastapi import APIRouter, Path, Query
from pydantic import Field

from semap.model.building import HeightBand, Mesh
from semap.model.source_geometry import PolygonMesh
from semap.store import abstractions
from semap.store.anchor import on_earth
from semap.store.instances import get_instance
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import BandDocument, Document, Id
from semap_service.documents.shape import ShapeDocument, shape_document
from semap_service.exchange.crs import Crs, epsg_of
from semap_service.http.etag import TaggedRoute, reads

router = APIRouter(tags=["abstractions"], route_class=TaggedRoute)

Kind = Annotated[
    abstractions.AbstractionType | abstractions.Direction,
    Path(description="One of SEMAP's abstractions, or a region on one of the six sides."),
]
Reach = Annotated[float, Query(gt=0, le=1e6, description="How far a region reaches [m].")]


class AbstractionDocument(Document):
    """One abstraction: flat ones and positions as GeoJSON, solids as a closed surface."""

    type: str = Field(examples=["FootprintHull"])
    crs: str | None = Field(description="null: metres in the requested frame.")
    geometry: ShapeDocument
    band: BandDocument | None = Field(description="Heights; null: it has none, or holds at every height.")


@router.get(
    "/descriptions/{id}/abstractions/{type}",
    operation_id="get_relative_abstraction",
    responses=reads(404, 413),
)
def get_relative(
    database: Database,
    id: Id,  # noqa: A002
    type: Kind,  # noqa: A002
    reach_m: Reach = 10.0,
) -> AbstractionDocument:
    """What follows from the geometries of a description, in its own frame (x forward, y left, z up)."""
    with transaction(database) as connection:
        if _is_direction(type):
            region = abstractions.region_of_description(connection, id, type, reach_m)
            return _document(type, region)
        found = abstractions.abstraction_of_description(connection, id, _kept(type))
    return _document(type, found.geometry, found.band)


@router.get(
    "/instances/{id}/abstractions/{type}",
    operation_id="get_absolute_abstraction",
    responses=reads(404, 409, 413),
)
def get_absolute(
    database: Database,
    id: Id,  # noqa: A002
    type: Kind,  # noqa: A002
    reach_m: Reach = 10.0,
    crs: Crs = None,
) -> AbstractionDocument:
    """What follows from the description of an instance and from where it stands, in the map frame."""
    with transaction(database) as connection:
        band = None
        shape: shapely.Geometry | Mesh | PolygonMesh
        if _is_direction(type):
            shape = abstractions.region_of_instance(connection, id, type, reach_m)
        else:
            found = abstractions.abstraction_of_instance(connection, id, _kept(type))
            shape, band = found.geometry, found.band
        epsg = epsg_of(crs)
        if epsg is not None:
            map_name = get_instance(connection, id).instance.map
            (shape,) = on_earth(connection, map_name, [shape], epsg)
    return _document(type, shape, band, crs)


def _is_direction(
    kind: abstractions.AbstractionType | abstractions.Direction,
) -> TypeGuard[abstractions.Direction]:
    return kind in get_args(abstractions.Direction)


def _kept(kind: abstractions.AbstractionType | abstractions.Direction) -> abstractions.AbstractionType:
    return cast(abstractions.AbstractionType, kind)


def _document(
    type_: str,
    shape: shapely.Geometry | Mesh | PolygonMesh,
    band: HeightBand | None = None,
    crs: str | None = None,
) -> AbstractionDocument:
    return AbstractionDocument(
        type=type_,
        crs=crs,
        geometry=shape_document(shape),
        band=None if band is None else BandDocument.model_validate(band),
    )
