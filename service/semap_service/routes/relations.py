"""/relations, and the rooms of a track"""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import Field

from semap.store import relations
from semap.store.maps import get_map
from semap.store.tracks import get_track
from semap_service.document import LARGEST_ID, LARGEST_SMALL_ID, Document, Id, Limit, MapFilter, Name, Stamp
from semap_service.problem import problems
from semap_service.transaction import Database, transaction

router = APIRouter(tags=["relations"])

PLACE = re.compile(r"(\d+)-(\d+)")


class RelationDocument(Document):
    """A track is in an instance, as a continuous query sees it."""

    map: str = Field(examples=["office"])
    query: str = Field(examples=["track_in_room"])
    track_id: int
    track: str = Field(examples=["person 3"])
    instance_id: int
    instance: str = Field(examples=["Room07"])
    since: Stamp


class RelationList(Document):
    relations: list[RelationDocument] = Field(description="By track.")
    next: str | None = Field(description="`after` of the next page; null where this is the last one.")


RelationAfter = Annotated[
    str,
    Query(pattern=r"^\d{1,19}-\d{1,10}$", description="Go on after this place: `next` of the page before."),
]


@router.get("/relations", operation_id="list_relations", responses=problems(404))
def list_relations(
    database: Database,
    map_name: MapFilter = None,
    track: Annotated[Name | None, Query(description="Only of the tracks of this name.")] = None,
    room: Annotated[Name | None, Query(description="Only to the instances of this name.")] = None,
    query: Annotated[Name | None, Query(description="Only those of the query of this name.")] = None,
    limit: Limit = 100,
    after: RelationAfter = "0-0",
) -> RelationList:
    """Who is where now, by name."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = relations.list_relations(
            connection,
            map_name=map_name,
            track_name=track,
            instance_name=room,
            query=query,
            after=_place(after),
            limit=limit,
        )
    return _page(found, limit)


@router.get("/tracks/{id}/rooms", operation_id="list_rooms_of_track", responses=problems(404))
def list_rooms_of_track(
    database: Database,
    id: Id,  # noqa: A002
    limit: Limit = 100,
    after: RelationAfter = "0-0",
) -> RelationList:
    """Which rooms this track is in now, and since when."""
    with transaction(database) as connection:
        get_track(connection, id)
        found = relations.list_relations(connection, track_id=id, after=_place(after), limit=limit)
    return _page(found, limit)


def _place(after: str) -> tuple[int, int]:
    match = PLACE.fullmatch(after)
    assert match is not None  # noqa: S101  (validated)
    return min(int(match[1]), LARGEST_ID), min(int(match[2]), LARGEST_SMALL_ID)


def _page(found: tuple[relations.Relation, ...], limit: int) -> RelationList:
    return RelationList(
        relations=[RelationDocument.model_validate(each) for each in found],
        next=f"{found[-1].track_id}-{found[-1].region_id}" if len(found) == limit else None,
    )
