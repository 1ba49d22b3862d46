"""/tracks"""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated, Any
from uuid import UUID

from fastapi import APIRouter, Query
from pydantic import Field, model_validator
from sqlalchemy import Connection

from semap.errors import InvalidInput
from semap.store.map.maps import get_map
from semap.store.motion import track_history, tracks
from semap.timeline.stamp import EARLIEST, LATEST, MICROSECOND
from semap_service.database.transaction import Database, Edit, transaction
from semap_service.documents.document import (
    After,
    Document,
    Id,
    InStamp,
    Limit,
    MapFilter,
    Name,
    Next,
    OfShape,
    PolygonDocument,
    Request,
    Stamp,
    next_after,
    require_order,
    stored,
)
from semap_service.http.etag import TaggedRoute, edits, reads
from semap_service.http.problem import problems

router = APIRouter(tags=["tracks"], route_class=TaggedRoute)

LONGEST_PATH = timedelta(days=7)
BEFORE_ALL = EARLIEST - MICROSECOND

STD = Field(description="Standard deviation [m], along the longer axis of its error ellipse; null: unknown.")
STD_ACROSS = Field(description="Along the shorter axis [m]; null: alike in all directions, or unknown.")
STD_YAW = Field(description="Where the longer axis points, from x towards y; null as `std_across_m`.")


class StateDocument(Document):
    """Where a track was seen, in the map frame."""

    stamp: Stamp
    x_m: float
    y_m: float
    z_m: float | None = Field(description="null where its source does not know heights.")
    std_m: float | None = STD
    heading_rad: float | None = Field(description="Where it faces, from x towards y; null: unknown.")
    speed_mps: float | None
    length_m: float | None = Field(description="Of the body, along its heading; null: unknown.")
    width_m: float | None
    std_across_m: float | None = STD_ACROSS
    std_yaw_rad: float | None = STD_YAW


class TrackStateDocument(StateDocument):
    """Where a track was last seen, in the map frame."""

    footprint: Annotated[PolygonDocument | None, OfShape] = Field(
        description="The ground that it covers; null where its extent is not known."
    )


Attributes = Annotated[
    dict[str, Any], Field(description="Whatever else is known.", examples=[{"kind": "forklift"}])
]


class TrackChanges(Request):
    """The changes; omitted members stay unchanged."""

    concept: Name | None = Field(None, description="Its concept; null: unknown.")
    attributes: Attributes | None = Field(None, description="Replaces all attributes.")

    @model_validator(mode="after")
    def _attributes_are_never_null(self) -> TrackChanges:
        if "attributes" in self.model_fields_set and self.attributes is None:
            raise ValueError("attributes cannot be null; leave it out to keep it")
        return self


class TrackDocument(Document):
    """Someone or something that a source follows."""

    id: int = stored("track_id")
    uid: UUID
    map: str = Field(examples=["office"])
    source: str = Field(examples=["lidar"])
    name: str = Field(examples=["person 3"])
    live: bool = Field(description="False until it is seen, and after its end.")
    ended_at: Stamp | None
    concept: str | None = Field(description="Its concept; null: not set.")
    attributes: Attributes
    state: TrackStateDocument | None = Field(description="null until it is seen.")


class PastStateDocument(StateDocument):
    """Where a track was seen, in the map frame."""

    is_last: bool = Field(description="It was gone after that.")


class TrackHistory(Document):
    """The states of a track."""

    track_id: int
    name: str
    states: list[PastStateDocument] = Field(description="In the order of their stamps.")
    next: Stamp | None = Field(description="`after` of the next page; null where this is the last one.")


class TrackPath(Document):
    """The way that a track went."""

    track_id: int
    name: str
    parts: list[list[list[float]]] = Field(
        description="x [m], y [m] and time [s, from `from` on] of the points of each line, in their order."
        " It was not seen for more than half a minute between two of them.",
        examples=[[[[1.0, 2.0, 0.0], [4.0, 2.0, 3.5]]]],
    )


class TrackList(Document):
    tracks: list[TrackDocument] = Field(description="In the order of their ids.")
    next: Next


@router.get("/tracks", operation_id="list_tracks", responses=reads(404))
def list_tracks(
    database: Database,
    map_name: MapFilter = None,
    name: Annotated[Name | None, Query(description="Only tracks of this name.")] = None,
    name_part: Annotated[
        Name | None, Query(description="Only tracks whose name has this part, in small or large letters.")
    ] = None,
    live: Annotated[bool | None, Query(description="Only those that are live, or that are not.")] = None,
    limit: Limit = 100,
    after: After = 0,
) -> TrackList:
    """The live tracks, with their positions."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = tracks.list_tracks(
            connection,
            map_name=map_name,
            name=name,
            name_part=name_part,
            live=live,
            after=after,
            limit=limit,
        )
    return TrackList(
        tracks=[TrackDocument.model_validate(each) for each in found],
        next=next_after([each.track_id for each in found], limit),
    )


@router.get("/tracks/{id}", operation_id="get_track", responses=reads(404))
def get_track(database: Database, id: Id) -> TrackDocument:  # noqa: A002
    """A track and where it is now."""
    with transaction(database) as connection:
        return _read(connection, id)


@router.patch("/tracks/{id}", operation_id="describe_track", responses=edits(404))
def describe_track(edit: Edit, id: Id, changes: TrackChanges) -> TrackDocument:  # noqa: A002
    """Set concept and attributes of a track. Queries select it by them from now on, with the cause `map`.

    With If-Match it is refused if the track has moved since it was read.
    """
    with edit.begin(lambda connection: _read(connection, id)) as connection:
        known = tracks.get_track(connection, id)
        concept = changes.concept if "concept" in changes.model_fields_set else known.concept
        attributes = known.attributes if changes.attributes is None else changes.attributes
        return TrackDocument.model_validate(tracks.describe_track(connection, id, concept, attributes))


@router.get("/tracks/{id}/history", operation_id="get_track_history", responses=reads(404))
def get_track_history(
    database: Database,
    id: Id,  # noqa: A002
    start: Annotated[
        InStamp, Query(alias="from", description="Not before this time (RFC 3339). [default: the beginning]")
    ] = EARLIEST,
    end: Annotated[
        InStamp, Query(alias="to", description="Not after this time (RFC 3339). [default: now]")
    ] = LATEST,
    limit: Annotated[int, Query(ge=1, le=10_000, description="At most so many.")] = 1000,
    after: Annotated[
        InStamp | None, Query(description="Go on after this time: `next` of the page before.")
    ] = None,
) -> TrackHistory:
    """Where this track was, state by state."""
    with transaction(database) as connection:
        track = tracks.get_track(connection, id)
        found = track_history.history(connection, id, start, end, after=after or BEFORE_ALL, limit=limit)
    return TrackHistory(
        track_id=track.track_id,
        name=track.name,
        states=[PastStateDocument.model_validate(each) for each in found],
        next=found[-1].stamp if len(found) == limit else None,
    )


@router.get("/tracks/{id}/path", operation_id="get_track_path", responses=problems(404))
def get_track_path(
    database: Database,
    id: Id,  # noqa: A002
    start: Annotated[InStamp, Query(alias="from", description="The earlier moment (RFC 3339).")],
    end: Annotated[
        InStamp, Query(alias="to", description="The later moment, included, at most a week after it.")
    ],
    tolerance_m: Annotated[
        float, Query(gt=0, le=10, description="How far from its positions the way may lie [m].")
    ] = 0.1,
) -> TrackPath:
    """The way that this track went, as lines with as few points as do."""
    require_order(start, end)
    if end - start > LONGEST_PATH:
        raise InvalidInput("it is more than a week after `from`", "Ask for less at a time.", "to")
    with transaction(database) as connection:
        track = tracks.get_track(connection, id)
        parts = track_history.path(connection, id, start, end, tolerance_m=tolerance_m)
    return TrackPath(track_id=track.track_id, name=track.name, parts=parts)


def _read(connection: Connection, track_id: int) -> TrackDocument:
    return TrackDocument.model_validate(tracks.get_track(connection, track_id))
