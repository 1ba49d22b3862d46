"""/rooms"""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import Field

from semap.store import relations
from semap.store.instances import get_instance
from semap.store.maps import get_map
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import After, Document, Id, Limit, MapFilter, Next, Stamp, next_after
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
