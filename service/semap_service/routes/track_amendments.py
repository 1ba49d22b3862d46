"""/track-amendments"""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field

from semap.store import track_amendments
from semap.store.maps import get_map
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import (
    After,
    Document,
    Limit,
    MapFilter,
    Name,
    Next,
    Stamp,
    next_after,
    stored,
)
from semap_service.http.problem import problems

router = APIRouter(tags=["tracks"])


class TrackAmendmentDocument(Document):
    """A correction of two tracks by their tracker."""

    id: int = stored("track_amendment_id", description="In the order of arrival.")
    map: str = Field(examples=["office"])
    source: str = Field(examples=["robot/persons"])
    kind: Literal["merged", "switched"] = Field(
        description="merged: both are one person; the other is the older track. switched: each followed the"
        " other's person."
    )
    track_id: int
    track: str = Field(examples=["person 3"])
    other_track_id: int
    other_track: str = Field(examples=["person 4"])
    since: Stamp = Field(description="From when on.")
    found: Stamp = Field(description="The stamp of the record that revealed it.")


class TrackAmendmentList(Document):
    track_amendments: list[TrackAmendmentDocument] = Field(description="In the order of their arrival.")
    next: Next


@router.get("/track-amendments", operation_id="list_track_amendments", responses=problems(404))
def list_track_amendments(
    database: Database,
    map_name: MapFilter = None,
    track: Annotated[Name | None, Query(description="Only of the tracks of this name.")] = None,
    limit: Limit = 100,
    after: After = 0,
) -> TrackAmendmentList:
    """Tracks that turned out to be one person, or that swapped persons.
    Tracks, relations and events stay as logged: take these into account when you count persons. New ones
    have larger ids than all earlier ones.
    """
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = track_amendments.list_track_amendments(
            connection, map_name=map_name, track_name=track, after=after, limit=limit
        )
    return TrackAmendmentList(
        track_amendments=[TrackAmendmentDocument.model_validate(each) for each in found],
        next=next_after([each.track_amendment_id for each in found], limit),
    )
