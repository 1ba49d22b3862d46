"""Ways of tracks: the reading half of OGC API Moving Features (OGC 22-003r3), in MF-JSON (OGC 19-045r3)"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Literal

import numpy as np
import shapely
from fastapi import APIRouter, Path, Query, Request, Response
from sqlalchemy import Connection

from semap.errors import InvalidInput, NotFound
from semap.model.track_state import TrackState
from semap.store.features.collection import Collection, get_collection
from semap.store.features.placing import Placing, System, placing_of, shown_shapes
from semap.store.motion.track_history import history, state_at, states_around
from semap.store.motion.tracks import get_track
from semap.timeline.stamp import EARLIEST, LATEST, MICROSECOND, rfc3339, to_datetime, to_us
from semap_service.database.transaction import Database, transaction
from semap_service.documents.ogc_features import JSON, Link
from semap_service.documents.ogc_moving_features import (
    MovingPoint,
    NamedSystem,
    TemporalGeometrySequence,
    TemporalProperties,
    TemporalProperty,
    TemporalPropertySummary,
    ValueSequence,
)
from semap_service.http.etag import reads
from semap_service.ogc import trajectory
from semap_service.ogc.crs import system_of, systems_of
from semap_service.ogc.links import add_headers, address, same_with
from semap_service.ogc.moving_feature import GREGORIAN
from semap_service.ogc.parameters import CollectionId, Crs, FeatureId, Format, at_most, interval_of, stamp_of
from semap_service.ogc.route import OgcRoute
from semap_service.ogc.trajectory import LONGEST_PIECE, UNITS, Piece, Quantity

router = APIRouter(tags=["OGC API"], route_class=OgcRoute)

MOST_LEAVES = 100
LONGEST_ID = 20

Pieces = Annotated[
    int,
    Query(ge=1, le=50, description=f"At most so many pieces, each of up to {LONGEST_PIECE} states."),
    at_most(50),
]
During = Annotated[
    str | None, Query(max_length=100, description="A time, or an interval that it meets (RFC 3339).")
]
Leaf = Annotated[
    str | None,
    Query(
        max_length=4000, description="Only at these times, which rise, by commas; between states on a line."
    ),
]
GeometryId = Annotated[
    str,
    Path(
        pattern=r"^-?\d{1,18}$", description="Its first stamp [us since 1970].", examples=["1769860800000000"]
    ),
]
PropertyName = Literal[
    "heading_rad", "speed_mps", "std_m", "std_across_m", "std_yaw_rad", "length_m", "width_m"
]

PROPERTIES: dict[PropertyName, tuple[str, Literal["Linear", "Step"], str]] = {
    "heading_rad": ("C81", "Step", "Where it faces, from x towards y."),
    "speed_mps": ("MTS", "Linear", "How fast it is."),
    "std_m": ("MTR", "Step", "Standard deviation of its place: along the longer axis of its error ellipse."),
    "std_across_m": ("MTR", "Step", "Along the shorter axis, where the two are not the same."),
    "std_yaw_rad": ("C81", "Step", "Where the longer axis points, from x towards y."),
    "length_m": ("MTR", "Step", "Of the body, along its heading."),
    "width_m": ("MTR", "Step", "Of the body."),
}
"""With their unit by UN/CEFACT's recommendation 20."""


@dataclass(frozen=True)
class _Asked:
    """Of which track what is asked, as of when."""

    track_id: int
    start: datetime | None
    end: datetime | None
    leaves: tuple[datetime, ...] | None
    cuts: bool


@router.get(
    "/collections/{collectionId}/items/{featureId}/tgsequence",
    operation_id="list_temporal_geometries",
    responses=reads(400, 404),
)
def list_temporal_geometries(
    request: Request,
    response: Response,
    database: Database,
    collectionId: CollectionId,
    featureId: FeatureId,
    datetime: During = None,
    leaf: Leaf = None,
    subTrajectory: Annotated[
        bool, Query(description="Cut it at the ends of `datetime`, on the line between two states.")
    ] = False,
    limit: Pieces = 10,
    after: Annotated[
        str | None, Query(pattern=r"^-?\d{1,18}$", description="Go on at this stamp: see the links.")
    ] = None,
    crs: Crs = None,
    f: Format = None,
) -> TemporalGeometrySequence:
    """Where a track was: its states, those of an interval, or where it was at given times."""
    with transaction(database) as connection:
        collection, placing = _tracks(connection, collectionId)
        uri, system = system_of(crs, systems_of(connection, placing), "crs")
        asked = _asked(connection, collection, featureId, datetime, leaf, subTrajectory)
        found, further = _read(connection, asked, limit, after)
        coordinates = _coordinates(connection, placing, system, found)
    links = [Link(href=same_with(request, {}), rel="self", type=JSON, title="This page")]
    if further is not None:
        more = same_with(request, {"after": str(to_us(further))})
        links.append(Link(href=more, rel="next", type=JSON, title="Where it went on"))
    add_headers(response, links)
    response.headers["Content-Crs"] = f"<{uri}>"
    return TemporalGeometrySequence(
        type="TemporalGeometrySequence",
        geometrySequence=[
            _moving_point(piece, places, "Linear" if asked.leaves is None else "Discrete")
            for piece, places in zip(found, coordinates, strict=True)
        ],
        crs=NamedSystem(type="Name", properties={"name": uri}),
        trs=NamedSystem(type="Name", properties={"name": GREGORIAN}),
        links=links,
        numberReturned=len(found),
    )


@router.get(
    "/collections/{collectionId}/items/{featureId}/tgsequence/{tGeometryId}",
    operation_id="get_temporal_geometry",
    responses=reads(400, 404),
)
def get_temporal_geometry(
    response: Response,
    database: Database,
    collectionId: CollectionId,
    featureId: FeatureId,
    tGeometryId: GeometryId,
    crs: Crs = None,
    f: Format = None,
) -> MovingPoint:
    """A piece of the way of a track: the states from one on, until it was lost, at most a thousand."""
    with transaction(database) as connection:
        collection, placing = _tracks(connection, collectionId)
        uri, system = system_of(crs, systems_of(connection, placing), "crs")
        piece = _piece(connection, collection, featureId, tGeometryId)
        coordinates = _coordinates(connection, placing, system, [piece])
    response.headers["Content-Crs"] = f"<{uri}>"
    return _moving_point(piece, coordinates[0], "Linear")


@router.get(
    "/collections/{collectionId}/items/{featureId}/tgsequence/{tGeometryId}/{quantity}",
    operation_id="measure_temporal_geometry",
    responses=reads(400, 404),
)
def measure_temporal_geometry(
    request: Request,
    database: Database,
    collectionId: CollectionId,
    featureId: FeatureId,
    tGeometryId: GeometryId,
    quantity: Quantity,
    f: Format = None,
) -> TemporalProperty:
    """How far a track came over a piece of its way, how fast, or how much faster each second."""
    with transaction(database) as connection:
        collection, _ = _tracks(connection, collectionId)
        piece = _piece(connection, collection, featureId, tGeometryId)
    values = trajectory.measured(piece, quantity)
    return TemporalProperty(
        name=quantity,
        type="TReal",
        form=UNITS[quantity],
        description="Of the piece, from its states.",
        valueSequence=[
            ValueSequence(
                datetimes=[rfc3339(each) for each in values.stamps],
                values=list(values.values),
                interpolation=values.interpolation,
            )
        ],
        links=[Link(href=same_with(request, {}), rel="self", type=JSON, title="This document")],
    )


@router.get(
    "/collections/{collectionId}/items/{featureId}/tproperties",
    operation_id="list_temporal_properties",
    responses=reads(400, 404),
)
def list_temporal_properties(
    request: Request,
    database: Database,
    collectionId: CollectionId,
    featureId: FeatureId,
    f: Format = None,
) -> TemporalProperties:
    """Which properties of a track change over time."""
    with transaction(database) as connection:
        collection, _ = _tracks(connection, collectionId)
        _track_id(connection, collection, featureId)
    links = [Link(href=same_with(request, {}), rel="self", type=JSON, title="This document")]
    here = ("collections", collectionId, "items", featureId, "tproperties")
    links += [
        Link(href=address(request, *here, name), rel="item", type=JSON, title=name) for name in PROPERTIES
    ]
    return TemporalProperties(
        temporalProperties=[
            TemporalPropertySummary(name=name, type="TReal", form=form, description=description)
            for name, (form, _, description) in PROPERTIES.items()
        ],
        links=links,
        numberMatched=len(PROPERTIES),
        numberReturned=len(PROPERTIES),
    )


@router.get(
    "/collections/{collectionId}/items/{featureId}/tproperties/{tPropertyName}",
    operation_id="get_temporal_property",
    responses=reads(400, 404),
)
def get_temporal_property(
    request: Request,
    database: Database,
    collectionId: CollectionId,
    featureId: FeatureId,
    tPropertyName: PropertyName,
    datetime: During = None,
    limit: Pieces = 10,
    after: Annotated[
        str | None, Query(pattern=r"^-?\d{1,18}$", description="Go on at this stamp: see the links.")
    ] = None,
    f: Format = None,
) -> TemporalProperty:
    """A property of a track over time, where it is known."""
    with transaction(database) as connection:
        collection, _ = _tracks(connection, collectionId)
        asked = _asked(connection, collection, featureId, datetime, None, False)
        found, further = _read(connection, asked, limit, after)
    links = [Link(href=same_with(request, {}), rel="self", type=JSON, title="This page")]
    if further is not None:
        more = same_with(request, {"after": str(to_us(further))})
        links.append(Link(href=more, rel="next", type=JSON, title="How it went on"))
    form, interpolation, description = PROPERTIES[tPropertyName]
    return TemporalProperty(
        name=tPropertyName,
        type="TReal",
        form=form,
        description=description,
        valueSequence=[
            ValueSequence(
                datetimes=[rfc3339(stamp) for stamp, _ in known],
                values=[value for _, value in known],
                interpolation=interpolation,
            )
            for known in (_known(piece, tPropertyName) for piece in found)
            if known
        ],
        links=links,
    )


def _tracks(connection: Connection, collection_id: str) -> tuple[Collection, Placing]:
    """raises NotFound also for a collection of what does not move"""
    found = get_collection(connection, collection_id)
    if found.kind != "tracks":
        raise NotFound("collection of moving features", collection_id, f"There is {found.map}.tracks.")
    return found, placing_of(connection, found.map_id, found.map)


def _track_id(connection: Connection, collection: Collection, feature_id: str) -> int:
    missing = NotFound("feature", feature_id, f"List /collections/{collection.id}/items to see their ids.")
    if not feature_id.isdecimal() or len(feature_id) >= LONGEST_ID or int(feature_id) >= 2**63:
        raise missing
    track = get_track(connection, int(feature_id))
    if track.map != collection.map:
        raise missing
    return track.track_id


def _asked(
    connection: Connection,
    collection: Collection,
    feature_id: str,
    during: str | None,
    leaf: str | None,
    cuts: bool,
) -> _Asked:
    start, end = interval_of(during)
    if cuts and (start is None or end is None or start == end):
        raise InvalidInput("it needs an interval with both ends", "Give datetime=from/to.", "subTrajectory")
    if cuts and leaf is not None:
        raise InvalidInput("a leaf beside it", "Give one of them.", "subTrajectory")
    leaves: tuple[datetime, ...] | None = None
    if leaf is not None:
        leaves = tuple(stamp_of(each, "leaf") for each in leaf.split(","))
        if len(leaves) > MOST_LEAVES or list(leaves) != sorted(set(leaves)):
            raise InvalidInput(
                "its times do not rise, or are too many",
                f"Give at most {MOST_LEAVES}, the first first.",
                "leaf",
            )
        leaves = tuple(
            each for each in leaves if (start is None or each >= start) and (end is None or each <= end)
        )
    return _Asked(_track_id(connection, collection, feature_id), start, end, leaves, cuts)


def _read(
    connection: Connection, asked: _Asked, limit: int, after: str | None
) -> tuple[list[Piece], datetime | None]:
    """Pieces of a way, and the stamp of the one after them, None where there is none."""
    if asked.leaves is not None:
        places = (
            trajectory.between(before, next_, stamp)
            for stamp, before, next_ in states_around(connection, asked.track_id, asked.leaves)
        )
        points = tuple(each for each in places if each is not None)
        return ([points] if points else []), None
    first = asked.start or EARLIEST
    if after is not None:
        first = max(first, _stamp(after))
    else:
        before = state_at(connection, asked.track_id, first)
        if before is not None and not before.is_last:
            first = before.stamp
    states = _history(connection, asked, first, limit * (LONGEST_PIECE - 1) + 2)
    found = list(trajectory.pieces(states))
    further = found[limit][0].stamp if len(found) > limit else None
    found = found[:limit]
    if asked.cuts and asked.start is not None and asked.end is not None:
        found = [piece for each in found if (piece := trajectory.cut(each, asked.start, asked.end))]
    return found, further


def _history(connection: Connection, asked: _Asked, first: datetime, limit: int) -> list[TrackState]:
    """States of the interval, and the one after it, to which the track was on its way."""
    end = asked.end or LATEST
    end = max(end, first)
    found = list(history(connection, asked.track_id, first, end, after=EARLIEST - MICROSECOND, limit=limit))
    if found and len(found) < limit and not found[-1].is_last and found[-1].stamp != asked.end:
        found += history(connection, asked.track_id, found[-1].stamp, LATEST, after=found[-1].stamp, limit=1)
    return found


def _piece(connection: Connection, collection: Collection, feature_id: str, id_: str) -> Piece:
    track_id = _track_id(connection, collection, feature_id)
    start = _stamp(id_)
    found = history(connection, track_id, start, LATEST, after=EARLIEST - MICROSECOND, limit=LONGEST_PIECE)
    if not found or found[0].stamp != start:
        raise NotFound("temporal geometry", id_, "List /tgsequence to see their ids.")
    return next(trajectory.pieces(found))


def _stamp(given: str) -> datetime:
    try:
        return min(max(to_datetime(int(given)), EARLIEST), LATEST)
    except OverflowError:
        return LATEST


def _coordinates(
    connection: Connection, placing: Placing, system: System, found: Sequence[Piece]
) -> list[list[list[float]]]:
    """The places of each piece in a system, with heights where all are known."""
    shapes = [
        shapely.multipoints(
            [
                (each.x_m, each.y_m, each.z_m) if _has_heights(piece) else (each.x_m, each.y_m)
                for each in piece
            ]
        )
        for piece in found
    ]
    shown = shown_shapes(connection, placing, shapes, system)
    digits = 9 if system.degrees else 6
    places = []
    for shape in shown:
        points = np.round(shapely.get_coordinates(shape, include_z=shape.has_z), digits)
        if system.north_first:
            points[:, [0, 1]] = points[:, [1, 0]]
        places.append(points.tolist())
    return places


def _has_heights(piece: Piece) -> bool:
    return all(each.z_m is not None for each in piece)


def _moving_point(
    piece: Piece, places: list[list[float]], interpolation: Literal["Linear", "Discrete"]
) -> MovingPoint:
    return MovingPoint(
        id=str(to_us(piece[0].stamp)),
        type="MovingPoint",
        datetimes=[rfc3339(each.stamp) for each in piece],
        coordinates=places,
        interpolation=interpolation,
    )


def _known(piece: Piece, name: PropertyName) -> list[tuple[datetime, float]]:
    values = ((each.stamp, getattr(each, name)) for each in piece)
    return [(stamp, value) for stamp, value in values if value is not None]
