"""/relations, and the rooms of a track"""

from __future__ import annotations

import re
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import Field
from sqlalchemy import Connection

from semap.store.map.maps import get_map
from semap.store.motion.tracks import get_track
from semap.store.relation import relations
from semap.store.relation.probability import probabilities
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import (
    LARGEST_ID,
    Document,
    Id,
    InStamp,
    Limit,
    MapFilter,
    Name,
    Stamp,
)
from semap_service.http.problem import problems

router = APIRouter(tags=["relations"])

PLACE = re.compile(r"([01])-(\d{1,19})-(-?\d{1,19})-(-?\d{1,19})")
SIDE = "null where that side is of the other kind."


class RelationDocument(Document):
    """A subject is related to an object, as a continuous query sees it: a track or an instance each."""

    map: str = Field(examples=["office"])
    query: str = Field(examples=["track_in_room"])
    track_id: int | None = Field(description=f"The subject; {SIDE}")
    track: str | None = Field(examples=["person 3"])
    subject_instance_id: int | None = Field(description=f"The subject; {SIDE}")
    subject_instance: str | None = Field(examples=[None])
    instance_id: int | None = Field(description=f"The object; {SIDE}")
    instance: str | None = Field(examples=["Room07"])
    object_track_id: int | None = Field(description=f"The object; {SIDE}")
    object_track: str | None = Field(examples=[None])
    since: Stamp
    until: Stamp | None = Field(description="null while it holds.")
    duration_s: float | None = Field(description="How long it held; null while it holds.", examples=[12.5])
    probability: float | None = Field(
        description="The probability by the track's present position; null where the query asks for no"
        " certainty.",
        examples=[0.97],
    )


class RelationList(Document):
    relations: list[RelationDocument] = Field(description="By query; those that are over last.")
    next: str | None = Field(description="`after` of the next page; null where this is the last one.")


AsOf = Annotated[
    InStamp | None,
    Query(description="What held at this event time (RFC 3339), by what is known now. [default: now]"),
]
RelationAfter = Annotated[
    str,
    Query(pattern=rf"^{PLACE.pattern}$", description="Go on after this place: `next` of the page before."),
]


@router.get("/relations", operation_id="list_relations", responses=problems(404))
def list_relations(
    database: Database,
    map_name: MapFilter = None,
    track: Annotated[
        Name | None, Query(description="Only of the tracks of this name, on either side.")
    ] = None,
    room: Annotated[
        Name | None, Query(description="Only of the instances of this name, on either side.")
    ] = None,
    query: Annotated[Name | None, Query(description="Only those of the query of this name.")] = None,
    as_of: AsOf = None,
    limit: Limit = 100,
    after: RelationAfter = "0-0-0-0",
) -> RelationList:
    """The current relations, by name; with `as_of` those at a time, with beginning and duration."""
    wanted = relations.Wanted(map_name, query, track=track, instance=room)
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = relations.list_relations(connection, wanted, as_of=as_of, after=_place(after), limit=limit)
        return _page(connection, found, limit)


@router.get("/tracks/{id}/rooms", operation_id="list_rooms_of_track", responses=problems(404))
def list_rooms_of_track(
    database: Database,
    id: Id,  # noqa: A002
    limit: Limit = 100,
    after: RelationAfter = "0-0-0-0",
) -> RelationList:
    """Which rooms this track is in now, and since when."""
    with transaction(database) as connection:
        get_track(connection, id)
        found = relations.list_relations_to_instances(connection, id, after=_place(after), limit=limit)
        return _page(connection, found, limit)


def _place(after: str) -> relations.Place:
    match = PLACE.fullmatch(after)
    assert match is not None  # noqa: S101  (validated)
    subject, object_ = (max(min(int(match[n]), LARGEST_ID), -LARGEST_ID) for n in (3, 4))
    return int(match[1]), min(int(match[2]), LARGEST_ID), subject, object_


def _page(connection: Connection, found: tuple[relations.Relation, ...], limit: int) -> RelationList:
    known = probabilities(connection, found)
    return RelationList(
        relations=[_document(each, known.get(each.place)) for each in found],
        next="-".join(map(str, found[-1].place)) if len(found) == limit else None,
    )


def _document(found: relations.Relation, probability: float | None) -> RelationDocument:
    duration_s = None if found.until is None else (found.until - found.since).total_seconds()
    computed = ("duration_s", "probability")
    said = {name: getattr(found, name) for name in RelationDocument.model_fields if name not in computed}
    return RelationDocument(**said, duration_s=duration_s, probability=probability)
