"""Where things are and were: shapes, tracks over time, the way from one thing to another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any
from urllib.parse import parse_qs, urlsplit

from semap.client.exchange import PAGE, Plan, Request, ask, get, given, read, segment
from semap.client.table import Table
from semap.client.values import Extent, Feature, Route, Track, TrackState, Whereabouts
from semap.errors import UntrustedBytes

MAP_FRAME = "urn:semap:crs:map-frame"
KEPT = ("name", "alias", "concept", "storey", "uid", "id", "created_at", "updated_at", "attributes")


def list_features(
    map: str,  # noqa: A002
    concept: str,
    *,
    filter: str | None = None,  # noqa: A002
    limit: int | None = None,
) -> Plan[Table[Feature]]:
    """What is of a concept or below it, by its outline, else as a point, in metres of the map frame.

    filter  CQL2 over its properties, such as "attributes.seats > 4" or "s_intersects(geometry, ...)"
    raises  NotFound, InvalidInput
    """
    path = f"/collections/{segment(f'{map}.{concept}')}/items"
    query = given({"crs": MAP_FRAME, "filter": filter, "filter-crs": MAP_FRAME if filter else None})
    found: list[Feature] = []
    while limit is None or len(found) < limit:
        size = PAGE if limit is None else min(PAGE, limit - len(found))
        document = (yield from ask(Request("GET", path, {**query, "limit": size}))).document()
        found += [_feature(each) for each in _members(document)]
        cursor = _next(document)
        if cursor is None:
            break
        query["cursor"] = cursor
    return Table(Feature, found)


def list_shapes(map: str) -> Plan[Table[Feature]]:  # noqa: A002
    """Everything on a map as a plan shows it: outlines, doors as lines, and what has no outline as points.

    raises  NotFound
    """
    path = f"/maps/{segment(map)}/export"
    document = (yield from ask(Request("GET", path, {"format": "geojson"}))).document()
    return Table(Feature, (_feature(each) for each in _members(document)))


def get_history(
    track_id: int, *, start: datetime | None = None, end: datetime | None = None, limit: int | None = None
) -> Plan[Table[TrackState]]:
    """Where a track was, from `start` to `end`, both included, by its stamps. raises NotFound"""
    path = f"/tracks/{track_id}/history"
    query = given({"from": start, "to": end})
    found: list[TrackState] = []
    while limit is None or len(found) < limit:
        size = PAGE if limit is None else min(PAGE, limit - len(found))
        document = (yield from ask(Request("GET", path, {**query, "limit": size}))).document()
        found += read(list[TrackState], _member(document, "states"))
        if document.get("next") is None:
            break
        query["after"] = document["next"]
    return Table(TrackState, found)


def get_whereabouts(instance_id: int, *, at: datetime | None = None) -> Plan[Whereabouts]:
    """Where an instance is, or was at a time: its pose, and the rooms that it is in. raises NotFound"""
    return (yield from get(Whereabouts, f"/instances/{instance_id}/where", at=at))


def get_extent(map: str) -> Plan[Extent]:  # noqa: A002
    """The first and the last stamp of all that was told of a map. raises NotFound"""
    return (yield from get(Extent, f"/maps/{segment(map)}/extent"))


def find_route(start: int | Track, end: int | Track) -> Plan[Route]:
    """The shortest way through doors, from an instance (by its id) or a track to another. raises NotFound"""
    return (yield from get(Route, "/route", **{"from": _place(start), "to": _place(end)}))


def _place(place: int | Track) -> str:
    return f"track:{place.id}" if isinstance(place, Track) else str(place)


def _members(document: object) -> Sequence[Mapping[str, Any]]:
    features = _member(document, "features")
    if not all(isinstance(each, dict) and isinstance(each.get("properties"), dict) for each in features):
        raise _unexpected()
    return features


def _member(document: object, name: str) -> list[Any]:
    found = document.get(name) if isinstance(document, dict) else None
    if not isinstance(found, list):
        raise _unexpected()
    return found


def _unexpected() -> UntrustedBytes:
    return UntrustedBytes(
        "The answer is not what was asked for.", "Let the client and the service be of the same version."
    )


def _feature(feature: Mapping[str, Any]) -> Feature:
    own = feature["properties"]
    more = {name: value for name, value in own.items() if name not in KEPT}
    return read(
        Feature,
        {
            **{name: own.get(name) for name in ("name", "alias", "concept", "storey", "uid")},
            "attributes": {**more, **(own.get("attributes") or {})},
            "geometry": feature.get("geometry"),
        },
    )


def _next(document: Any) -> str | None:
    """The cursor of the next page."""
    for link in document.get("links", ()):
        if link.get("rel") == "next":
            return next(iter(parse_qs(urlsplit(link["href"]).query).get("cursor", ())), None)
    return None
