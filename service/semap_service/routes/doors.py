"""/doors"""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field

from semap.store import doors
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

router = APIRouter(tags=["doors"])

State = Literal["opening", "open", "closing", "closed"]


class DoorDocument(Document):
    """A door with a leaf, as it was last seen."""

    id: int = stored("instance_id", description="Of the instance.")
    map: str = Field(examples=["office"])
    name: str = stored("door", examples=["Door07"])
    state: State | None = Field(description="null until it is seen, and again after it was moved.")
    since: Stamp | None = Field(description="When this state began.")
    stamp: Stamp | None = Field(description="When its leaf was last seen.")
    angle_deg: float | None = Field(description="From where it is closed to where it was last seen.")
    angle_std_deg: float | None = Field(description="Standard deviation of this angle.")
    width_m: float = Field(description="Of the leaf.")
    max_deg: float = Field(description="How far it opens.")
    rooms: list[str] = Field(description="The rooms that it joins, by name.")


class DoorList(Document):
    doors: list[DoorDocument] = Field(description="In the order of their ids.")
    next: Next


@router.get("/doors", operation_id="list_doors", responses=problems(404))
def list_doors(
    database: Database,
    map_name: MapFilter = None,
    name: Annotated[Name | None, Query(description="Only doors of this name.")] = None,
    state: Annotated[State | None, Query(description="Only those that stand so.")] = None,
    limit: Limit = 100,
    after: After = 0,
) -> DoorList:
    """Doors that have a leaf, with their states.

    A door without a leaf is an opening and has no state. Reported states of any door are in /object-states.
    """
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = doors.list_doors(
            connection, map_name=map_name, name=name, state=state, after=after, limit=limit
        )
    return DoorList(
        doors=[DoorDocument.model_validate(each) for each in found],
        next=next_after([each.instance_id for each in found], limit),
    )
