"""/collections: which there are, and what can be asked of each"""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from sqlalchemy import Connection

from semap.store.features.collection import Collection, get_collection, list_collections
from semap.store.features.extent import Extent, extents_of
from semap.store.features.placing import placing_of
from semap.store.features.source import source_of
from semap.timeline.stamp import rfc3339
from semap_service.database.transaction import Database, transaction
from semap_service.documents.ogc_features import (
    JSON,
    CollectionDocument,
    CollectionExtent,
    Collections,
    Link,
    PropertiesSchema,
    SchemaJson,
    SpatialExtent,
    TemporalExtent,
)
from semap_service.http.etag import reads
from semap_service.ogc import queryables as schemas
from semap_service.ogc.crs import CRS84_URI, systems_of
from semap_service.ogc.links import add_headers, address, collection_links, same_with
from semap_service.ogc.parameters import CollectionId, Format, at_most
from semap_service.ogc.route import OgcRoute

router = APIRouter(tags=["OGC API"], route_class=OgcRoute)

GREGORIAN = "http://www.opengis.net/def/uom/ISO-8601/0/Gregorian"
LARGEST_OFFSET = 10_000_000

Offset = Annotated[int, Query(ge=0, le=LARGEST_OFFSET, description="Leave out so many at the beginning.")]

MEANINGS = {
    "tracks": "Tracks at their last positions; /items/{id}/tgsequence is the trajectory.",
    "relations": "Which track is in which instance now, each where the track is.",
    "events": "What happened, each where its track was, or else where its instance is.",
}


@router.get(
    "/collections", operation_id="list_collections", response_model_exclude_none=True, responses=reads(400)
)
def list_all(
    request: Request,
    response: Response,
    database: Database,
    limit: Annotated[int, Query(ge=1, le=10_000, description="At most so many."), at_most(10_000)] = 1000,
    offset: Offset = 0,
    f: Format = None,
) -> Collections:
    """Of each map one for each concept that it has instances of, and its tracks, relations and events."""
    with transaction(database) as connection:
        found = list_collections(connection, limit=limit + 1, offset=offset)
        shown = found[:limit]
        extents = extents_of(connection, shown)
        crs = {each.map_id: _crs(connection, each) for each in {one.map_id: one for one in shown}.values()}
    links = [
        Link(href=same_with(request, {}), rel="self", type=JSON, title="This document"),
        Link(href=address(request, ""), rel="root", type=JSON, title="Where everything is"),
    ]
    if len(found) > limit:
        further = same_with(request, {"offset": offset + limit})
        links.append(Link(href=further, rel="next", type=JSON, title="More collections"))
    if offset:
        earlier = same_with(request, {"offset": max(0, offset - limit) or None})
        links.append(Link(href=earlier, rel="prev", type=JSON, title="Collections before"))
    add_headers(response, links)
    return Collections(
        collections=[_document(request, each, crs[each.map_id], extents[each.id]) for each in shown],
        links=links,
        numberReturned=len(shown),
    )


@router.get(
    "/collections/{collectionId}",
    operation_id="get_collection",
    response_model_exclude_none=True,
    responses=reads(400, 404),
)
def get_one(
    request: Request, response: Response, database: Database, collectionId: CollectionId, f: Format = None
) -> CollectionDocument:
    """A collection with its extent."""
    with transaction(database) as connection:
        found = get_collection(connection, collectionId)
        extent = extents_of(connection, [found])[found.id]
        document = _document(request, found, _crs(connection, found), extent)
    add_headers(response, document.links)
    return document


@router.get(
    "/collections/{collectionId}/queryables",
    operation_id="get_queryables",
    response_class=SchemaJson,
    responses=reads(400, 404),
)
def get_queryables(
    request: Request, database: Database, collectionId: CollectionId, f: Format = None
) -> PropertiesSchema:
    """What filters may ask, as JSON Schema."""
    with transaction(database) as connection:
        found = get_collection(connection, collectionId)
    return schemas.queryables(request, found, source_of(found))


@router.get(
    "/collections/{collectionId}/sortables",
    operation_id="get_sortables",
    response_class=SchemaJson,
    responses=reads(400, 404),
)
def get_sortables(
    request: Request, database: Database, collectionId: CollectionId, f: Format = None
) -> PropertiesSchema:
    """Properties for sorting, as JSON Schema."""
    with transaction(database) as connection:
        found = get_collection(connection, collectionId)
    return schemas.sortables(request, found, source_of(found))


def _crs(connection: Connection, collection: Collection) -> list[str]:
    return list(systems_of(connection, placing_of(connection, collection.map_id, collection.map)))


def _document(request: Request, collection: Collection, crs: list[str], extent: Extent) -> CollectionDocument:
    return CollectionDocument(
        id=collection.id,
        title=f"{collection.concept or collection.kind} of {collection.map}",
        description=_description(collection, crs),
        itemType="feature",
        crs=crs,
        extent=_extent(extent),
        links=collection_links(request, collection.id),
    )


def _description(collection: Collection, crs: list[str]) -> str:
    what = MEANINGS.get(
        collection.kind, f"What is a {collection.concept} or of a concept below it, by its outline."
    )
    if len(crs) > DEFAULT_SYSTEMS:
        return what
    return f"{what} The map has no anchor: its metres are shown at 0 N 0 E, x to the east, y to the north."


DEFAULT_SYSTEMS = 5
"""So many every map is offered in; one with an anchor also in that one's."""


def _extent(extent: Extent) -> CollectionExtent | None:
    spatial = temporal = None
    if extent.bounds is not None:
        spatial = SpatialExtent(bbox=[list(extent.bounds)], crs=CRS84_URI)
    if extent.timed:
        ends = [None if each is None else rfc3339(each) for each in (extent.first, extent.last)]
        temporal = TemporalExtent(interval=[ends], trs=GREGORIAN)
    if spatial is None and temporal is None:
        return None
    return CollectionExtent(spatial=spatial, temporal=temporal)
