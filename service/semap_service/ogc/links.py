"""Links between documents: absolute addresses, as the caller reached this one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from urllib.parse import quote, urlencode

from fastapi import Request, Response

from semap_service.documents.ogc_features import GEO_JSON, JSON, SCHEMA_JSON, Link


def address(request: Request, *path: str, **query: object) -> str:
    """The address of a path of this service; `path` are its parts, as they are."""
    base = str(request.base_url).rstrip("/")
    whole = base + "/" + "/".join(quote(part, safe="~") for part in path)
    given = {name: value for name, value in query.items() if value is not None}
    return f"{whole}?{urlencode(given)}" if given else whole


def same_with(request: Request, changes: Mapping[str, object]) -> str:
    """The address of this request with other parameters; None removes one."""
    given = dict(request.query_params.multi_items()) | dict(changes)
    query = urlencode({name: value for name, value in given.items() if value is not None})
    whole = str(request.base_url).rstrip("/") + quote(request.url.path, safe="/~:@")
    return f"{whole}?{query}" if query else whole


def link_header(links: Iterable[Link]) -> str:
    """The same as a header (RFC 8288)."""
    return ", ".join(f'<{each.href}>; rel="{each.rel}"; type="{each.type}"' for each in links)


def add_headers(response: Response, links: Iterable[Link]) -> None:
    response.headers["Link"] = link_header(links)


def collection_links(request: Request, id_: str) -> list[Link]:
    here = ("collections", id_)
    return [
        Link(href=address(request, *here), rel="self", type=JSON, title="This collection"),
        Link(href=address(request, *here, "items"), rel="items", type=GEO_JSON, title="Its features"),
        Link(
            href=address(request, *here, "queryables"),
            rel="http://www.opengis.net/def/rel/ogc/1.0/queryables",
            type=SCHEMA_JSON,
            title="What filters may ask",
        ),
        Link(
            href=address(request, *here, "sortables"),
            rel="http://www.opengis.net/def/rel/ogc/1.0/sortables",
            type=SCHEMA_JSON,
            title="What can be sorted by",
        ),
    ]
