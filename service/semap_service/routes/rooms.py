"""/rooms"""

from __future__ import annotations

from datetime import timedelta
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import Field

from semap.errors import InvalidInput
from semap.store.map.instances import get_instance
from semap.store.map.maps import get_map
from semap.store.relation import occupancy, relations
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import (
    After,
    Document,
    Id,
    InStamp,
    Limit,
    MapFilter,
    Next,
    Stamp,
    next_after,
    require_order,
)
from semap_service.documents.instance import InstanceDocument, InstanceSummary, detail
from semap_service.exchange.crs import Crs, footprint_in
from semap_service.http.problem import problems

router = APIRouter(tags=["rooms"])


class RoomSummary(InstanceSummary):
    """A room, and how many tracks are in it now."""

    occupants: int


class RoomList(Document):
    rooms: list[RoomSummary] = Field(description="In the order of their ids.")
    next: Next


class RoomDocument(InstanceDocument):
    """A room with its outline, and how many tracks are in it now."""

    occupants: int


class OccupantDocument(Document):
    """Someone or something in a room."""

    track_id: int
    name: str = Field(examples=["person 3"])
    since: Stamp


class OccupantList(Document):
    occupants: list[OccupantDocument] = Field(description="In the order of the tracks' ids.")
    next: Next


class OccupancySpan(Document):
    """How many tracks were in a room in a span of time."""

    since: Stamp
    until: Stamp
    mean: float = Field(description="On average over that time.", examples=[1.7])
    peak: int = Field(description="At most.")
    peak_at: Stamp | None = Field(description="Since when so many were in it at first; null: nobody was.")
    tracks: int = Field(description="How many different ones.")


class VisitorDocument(Document):
    """A track that was in a room."""

    track_id: int
    name: str = Field(examples=["person 3"])
    stays: int = Field(description="How often.")
    total_s: float = Field(description="How long in all [s].")
    since: Stamp = Field(description="From when on.")
    until: Stamp = Field(description="Until when.")


class OccupancyDocument(Document):
    """A room over time. Stays are cut to the time that was asked for."""

    instance_id: int
    name: str = Field(examples=["Room07"])
    spans: list[OccupancySpan]
    stays: int
    tracks: int = Field(description="How many different ones.")
    total_s: float = Field(description="Of all stays [s].")
    median_s: float | None = Field(description="Half of the stays were shorter [s].")
    longest_s: float | None = Field(description="The longest stay [s].")
    visitors: list[VisitorDocument] = Field(description="At most `limit`, who was in it longest first.")


LONGEST = {"hour": timedelta(days=62), "day": timedelta(days=732)}


@router.get("/rooms", operation_id="list_rooms", responses=problems(404))
def list_rooms(
    database: Database, map_name: MapFilter = None, limit: Limit = 100, after: After = 0
) -> RoomList:
    """Instances of Room and of concepts below it, with how many are in them."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = relations.list_rooms(connection, map_name=map_name, after=after, limit=limit)
    return RoomList(
        rooms=[
            RoomSummary(**dict(InstanceSummary.model_validate(each.instance)), occupants=each.occupants)
            for each in found
        ],
        next=next_after([each.instance.instance_id for each in found], limit),
    )


@router.get("/rooms/{id}", operation_id="get_room", responses=problems(404, 409))
def get_room(database: Database, id: Id, crs: Crs = None) -> RoomDocument:  # noqa: A002
    """A room with its outline."""
    with transaction(database) as connection:
        room = relations.get_room(connection, id)
        document = detail(footprint_in(connection, get_instance(connection, id), crs), crs)
    return RoomDocument(**dict(document), occupants=room.occupants)


@router.get("/rooms/{id}/occupants", operation_id="list_occupants", responses=problems(404))
def list_occupants(database: Database, id: Id, limit: Limit = 100, after: After = 0) -> OccupantList:  # noqa: A002
    """The tracks in this room, and since when."""
    with transaction(database) as connection:
        found = relations.list_occupants(connection, id, after=after, limit=limit)
    return OccupantList(
        occupants=[OccupantDocument.model_validate(each) for each in found],
        next=next_after([each.track_id for each in found], limit),
    )


@router.get("/rooms/{id}/occupancy", operation_id="get_occupancy", responses=problems(404))
def get_occupancy(
    database: Database,
    id: Id,  # noqa: A002
    start: Annotated[InStamp, Query(alias="from", description="The earlier moment (RFC 3339).")],
    end: Annotated[InStamp, Query(alias="to", description="The later moment, not included.")],
    each: Annotated[
        occupancy.Unit, Query(description="Hour by hour, for 62 days at most, or day by day, for two years.")
    ] = "hour",
    zone: Annotated[
        str, Query(max_length=64, description="In whose hours and days (IANA).", examples=["Europe/Berlin"])
    ] = "UTC",
    limit: Limit = 20,
) -> OccupancyDocument:
    """How many tracks were in this room over time, how long, and which, as queries found it."""
    require_order(start, end)
    if start == end or end - start > LONGEST[each]:
        raise InvalidInput(
            f"of {each}s, at most {LONGEST[each].days} days are told at a time", "Ask for less.", "to"
        )
    with transaction(database) as connection:
        room = relations.get_room(connection, id).instance
        found = occupancy.occupancy(connection, id, start, end, each=each, zone=zone, visitors=limit)
    return OccupancyDocument(
        instance_id=room.instance_id,
        name=room.name,
        spans=[OccupancySpan.model_validate(span) for span in found.spans],
        stays=found.stays,
        tracks=found.tracks,
        total_s=found.total_s,
        median_s=found.median_s,
        longest_s=found.longest_s,
        visitors=[VisitorDocument.model_validate(visitor) for visitor in found.visitors],
    )
