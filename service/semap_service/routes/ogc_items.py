"""/collections/{collectionId}/items: features, page by page, and one by one"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.store.features.collection import Collection, get_collection
from semap.store.features.page import Page, Wanted, read_feature, read_page
from semap.store.features.placing import placing_of
from semap.store.features.source import source_of
from semap_service.database.transaction import Database, transaction
from semap_service.documents.ogc_features import (
    GEO_JSON,
    JSON,
    FeatureCollection,
    GeoJson,
    Link,
    LinkedFeature,
)
from semap_service.http.etag import reads
from semap_service.ogc import parameters
from semap_service.ogc.crs import system_of, systems_of
from semap_service.ogc.links import add_headers, address, same_with
from semap_service.ogc.moving_feature import moving_members
from semap_service.ogc.parameters import CollectionId, Crs, FeatureId, Format
from semap_service.ogc.route import OgcRoute

router = APIRouter(tags=["OGC API"], route_class=OgcRoute)

LARGEST_PAGE = 10_000

Properties = Annotated[
    str | None, Query(max_length=4000, description="Only these properties, by commas. [default: all]")
]


@router.get(
    "/collections/{collectionId}/items",
    operation_id="list_features",
    response_class=GeoJson,
    response_model=FeatureCollection,
    responses=reads(400, 404),
)
def list_features(
    request: Request,
    database: Database,
    collectionId: CollectionId,
    limit: Annotated[
        int, Query(ge=1, le=LARGEST_PAGE, description="At most so many."), parameters.at_most(LARGEST_PAGE)
    ] = 100,
    offset: Annotated[
        int | None, Query(ge=0, le=10_000_000, description="Leave out so many at the beginning.")
    ] = None,
    cursor: Annotated[
        str | None, Query(max_length=8000, description="Go on where another page ended: see its links.")
    ] = None,
    bbox: Annotated[
        str | None, Query(max_length=400, description="west,south,east,north; or six numbers with heights.")
    ] = None,
    bbox_crs: Annotated[
        str | None,
        Query(alias="bbox-crs", max_length=200, description="Of bbox. [default: CRS84]"),
    ] = None,
    datetime: Annotated[
        str | None,
        Query(max_length=100, description="A time, or an interval: from/to, ../to, from/.. (RFC 3339)."),
    ] = None,
    filter: Annotated[str | None, Query(max_length=20_000, description="CQL2, text or JSON.")] = None,  # noqa: A002
    filter_lang: Annotated[
        Literal["cql2-text", "cql2-json"] | None, Query(alias="filter-lang", description="Of the filter.")
    ] = None,
    filter_crs: Annotated[
        str | None,
        Query(alias="filter-crs", max_length=200, description="The system of its shapes. [default: CRS84]"),
    ] = None,
    sortby: Annotated[
        str | None, Query(max_length=1000, description="Properties by commas, - before one that falls.")
    ] = None,
    properties: Properties = None,
    crs: Crs = None,
    f: Format = None,
) -> Response:
    """Features that meet all that is asked, with how many there are in all.

    `next` and `prev` go on by a cursor, so that a page is found as fast as the first one and nothing is left
    out or repeated where features come and go; with `offset` they count.
    """
    if offset is not None and cursor is not None:
        raise InvalidInput("an offset beside it", "Give one of them.", "cursor")
    with transaction(database) as connection:
        collection = get_collection(connection, collectionId)
        placing = placing_of(connection, collection.map_id, collection.map)
        systems = systems_of(connection, placing)
        source = source_of(collection)
        _, box_system = system_of(bbox_crs, systems, "bbox-crs")
        _, filter_system = system_of(filter_crs, systems, "filter-crs")
        uri, system = system_of(crs, systems, "crs")
        start, end = parameters.interval_of(datetime)
        wanted = Wanted(
            boxes=parameters.boxes_of(bbox, box_system),
            box_system=box_system,
            start=start,
            end=end,
            filter=parameters.filter_of(filter, filter_lang, source, degrees=filter_system.degrees),
            filter_system=filter_system,
            sort=parameters.sort_of(sortby, source),
            properties=parameters.properties_of(properties, source),
            system=system,
        )
        page = read_page(
            connection,
            collection,
            placing,
            wanted,
            limit=limit,
            offset=offset or 0,
            cursor=parameters.read_cursor(cursor, sortby or ""),
        )
    links = _links(request, collection, page, limit=limit, offset=offset, order=sortby or "")
    return _page_response(page, links, uri)


@router.get(
    "/collections/{collectionId}/items/{featureId}",
    operation_id="get_feature",
    response_class=GeoJson,
    response_model=LinkedFeature,
    responses=reads(400, 404),
)
def get_feature(
    request: Request,
    database: Database,
    collectionId: CollectionId,
    featureId: FeatureId,
    properties: Properties = None,
    crs: Crs = None,
    f: Format = None,
) -> Response:
    """One feature. A track is a moving feature (OGC 19-045r3), whose way is at its links."""
    with transaction(database) as connection:
        collection = get_collection(connection, collectionId)
        placing = placing_of(connection, collection.map_id, collection.map)
        uri, system = system_of(crs, systems_of(connection, placing), "crs")
        wanted = Wanted(properties=parameters.properties_of(properties, source_of(collection)), system=system)
        feature = read_feature(connection, collection, placing, featureId, wanted)
        more = _moving(connection, collection, featureId, uri)
    links = _feature_links(request, collection, featureId)
    more["links"] = [each.model_dump() for each in links]
    response = GeoJson(None, headers={"Content-Crs": f"<{uri}>"})
    response.body = (feature[:-1] + "," + json.dumps(more)[1:]).encode()
    response.headers["Content-Length"] = str(len(response.body))
    add_headers(response, links)
    return response


def _moving(connection: Connection, collection: Collection, feature_id: str, uri: str) -> dict[str, object]:
    return moving_members(connection, int(feature_id), uri) if collection.kind == "tracks" else {}


def _links(
    request: Request, collection: Collection, page: Page, *, limit: int, offset: int | None, order: str
) -> list[Link]:
    links = [
        Link(href=same_with(request, {}), rel="self", type=GEO_JSON, title="This page"),
        Link(
            href=address(request, "collections", collection.id),
            rel="collection",
            type=JSON,
            title="The collection",
        ),
    ]
    for rel, there_is, place, back in (
        ("next", page.after, page.last, False),
        ("prev", page.before, page.first, True),
    ):
        if not there_is:
            continue
        if offset is not None:
            changes: dict[str, object] = {"offset": max(0, offset - limit if back else offset + limit)}
        elif place is not None:
            changes = {"cursor": parameters.write_cursor(place, order, back=back)}
        else:
            continue
        links.append(Link(href=same_with(request, changes), rel=rel, type=GEO_JSON, title=f"The {rel} page"))
    return links


def _feature_links(request: Request, collection: Collection, feature_id: str) -> list[Link]:
    here = ("collections", collection.id, "items", feature_id)
    links = [
        Link(href=same_with(request, {}), rel="self", type=GEO_JSON, title="This feature"),
        Link(
            href=address(request, "collections", collection.id),
            rel="collection",
            type=JSON,
            title="The collection",
        ),
    ]
    if collection.kind == "tracks":
        links += [
            Link(href=address(request, *here, "tgsequence"), rel="tgsequence", type=JSON, title="Its way"),
            Link(
                href=address(request, *here, "tproperties"),
                rel="tproperties",
                type=JSON,
                title="Its properties over time",
            ),
        ]
    return links


def _page_response(page: Page, links: Sequence[Link], uri: str) -> Response:
    head = {
        "type": "FeatureCollection",
        "numberMatched": page.matched,
        "numberReturned": len(page.features),
        "links": [each.model_dump() for each in links],
    }
    response = GeoJson(None, headers={"Content-Crs": f"<{uri}>"})
    features = ",".join(page.features)
    response.body = (json.dumps(head)[:-1] + f', "features": [{features}]}}').encode()
    response.headers["Content-Length"] = str(len(response.body))
    add_headers(response, links)
    return response
