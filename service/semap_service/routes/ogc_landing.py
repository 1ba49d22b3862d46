"""/, /conformance and /api: where clients of OGC API begin"""

from __future__ import annotations

from typing import Any, Literal

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse
from starlette.datastructures import MutableHeaders

from semap import __version__
from semap_service.documents.document import Document
from semap_service.documents.ogc_features import JSON, OPENAPI_JSON, Conformance, LandingPage, Link
from semap_service.http import page
from semap_service.http.etag import reads
from semap_service.ogc.conformance import CLASSES
from semap_service.ogc.links import add_headers, address
from semap_service.ogc.openapi30 import as_openapi30
from semap_service.ogc.route import OgcRoute

router = APIRouter(tags=["OGC API"], route_class=OgcRoute)

RESOURCES = (
    "maps",
    "instances",
    "rooms",
    "doors",
    "tracks",
    "track-amendments",
    "operators",
    "relations",
    "object-states",
    "events",
    "queries",
    "rules",
    "concepts",
)
HTML = "text/html"


class OpenApi30(JSONResponse):
    media_type = OPENAPI_JSON


class OpenApiDocument(Document):
    """A description of an interface (OpenAPI 3.0)."""

    openapi: Literal["3.0.3"]
    info: dict[str, Any]
    paths: dict[str, Any]
    components: dict[str, Any]


@router.get("/", operation_id="get_landing_page", responses=reads(400))
def get_landing_page(request: Request, response: Response) -> LandingPage:
    """Where everything is. To a browser: the page of the map."""
    if _wants_html(request.headers.get("accept", "")):
        front = page.front(request)
        MutableHeaders(raw=front.raw_headers).add_vary_header("Accept")
        return front  # type: ignore[return-value]  # a response is sent as it is
    links = [
        Link(href=address(request, ""), rel="self", type=JSON, title="This document"),
        Link(href=address(request, "api"), rel="service-desc", type=OPENAPI_JSON, title="OpenAPI 3.0"),
        Link(href=address(request, "docs"), rel="service-doc", type=HTML, title="Documentation"),
        Link(href=address(request, "conformance"), rel="conformance", type=JSON, title="Conformance"),
        Link(
            href=address(request, "conformance"),
            rel="http://www.opengis.net/def/rel/ogc/1.0/conformance",
            type=JSON,
            title="Conformance",
        ),
        Link(href=address(request, "collections"), rel="data", type=JSON, title="Collections of features"),
        Link(
            href=address(request, "collections"),
            rel="http://www.opengis.net/def/rel/ogc/1.0/data",
            type=JSON,
            title="Collections of features",
        ),
        Link(href=address(request, "openapi.json"), rel="related", type=JSON, title="OpenAPI 3.1 of all"),
        Link(href=address(request, "health"), rel="status", type=JSON, title="Whether it works"),
        *(Link(href=address(request, each), rel="related", type=JSON, title=each) for each in RESOURCES),
    ]
    add_headers(response, links[:6])
    response.headers["Vary"] = "Accept"
    return LandingPage(
        title="semap",
        description="Semantic maps with what is where, who is in which room, and what happened.",
        name="semap",
        version=__version__,
        links=links,
    )


@router.get("/conformance", operation_id="get_conformance", responses=reads(400))
def get_conformance() -> Conformance:
    """Which requirements of OGC API hold here."""
    return Conformance(conformsTo=list(CLASSES))


@router.get(
    "/api",
    operation_id="get_openapi_30",
    response_class=OpenApi30,
    response_model=OpenApiDocument,
    responses=reads(400),
)
def get_openapi_30(request: Request) -> Response:
    """The interface in OpenAPI 3.0, which clients of OGC API read; /openapi.json is OpenAPI 3.1."""
    return OpenApi30(as_openapi30(request.app.openapi()))


def _wants_html(accept: str) -> bool:
    """Whether HTML is asked for before any JSON, as browsers do."""
    kinds = [each.partition(";")[0].strip() for each in accept.split(",")]
    json_at = next((n for n, each in enumerate(kinds) if each.endswith("json")), len(kinds))
    return HTML in kinds[:json_at]
