"""/route"""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import Field

from semap.errors import InvalidInput
from semap.store.map import route
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import LARGEST_ID, Document
from semap_service.http.problem import problems

router = APIRouter(tags=["instances"])

PLACE = r"^(track:)?[1-9]\d{0,18}$"
TRACK = "track:"


class StepDocument(Document):
    """A room on the way."""

    room_id: int
    room: str = Field(examples=["Corridor"])
    door_id: int | None = Field(description="The door by which it is entered; null where the way begins.")
    door: str | None = Field(examples=["Door07"])
    length_m: float = Field(description="Of the way to that door.")


class PartDocument(Document):
    """Rooms between which there are ways."""

    rooms: int = Field(description="How many.")
    names: list[str] = Field(description="Of the first 20, by name.")
    storeys: list[str] = Field(description="On which they are.")


class GapDocument(Document):
    """Why there is no way: two parts of the building that nothing connects."""

    reason: str
    start: PartDocument
    end: PartDocument


class WayDocument(Document):
    """The shortest way through doors, openings, stairs and lifts."""

    length_m: float | None = Field(
        description="From the first room's position to the last one's; null: none."
    )
    steps: list[StepDocument] = Field(description="The rooms in their order; empty where there is no way.")
    line: list[list[float]] = Field(
        description="x, y and, where it is known, z [m] of the rooms' positions and the doors between them."
    )
    gap: GapDocument | None = Field(
        description="Where there is no way: the parts of the building that are not connected."
    )


@router.get("/route", operation_id="find_route", responses=problems(404))
def find_route(
    database: Database,
    start: Annotated[
        str,
        Query(
            alias="from",
            pattern=PLACE,
            description="Id of an instance, or track:ID of a track.",
            examples=["7", "track:3"],
        ),
    ],
    end: Annotated[str, Query(alias="to", pattern=PLACE, description="Likewise.", examples=["12"])],
) -> WayDocument:
    """The shortest route from the room of one instance or track to that of another: doors and length.
    A room is its own; any other instance is in the smallest room around it, and a door in one that it joins.
    """
    with transaction(database) as connection:
        found = route.way(connection, _place(start, "from"), _place(end, "to"))
    return WayDocument.model_validate(found)


def _place(given: str, where: str) -> route.Place:
    id_ = int(given.removeprefix(TRACK))
    if id_ > LARGEST_ID:
        raise InvalidInput("it is no id", "Give the id of an instance, or track:ID.", where)
    return route.Place("track" if given.startswith(TRACK) else "instance", id_)
