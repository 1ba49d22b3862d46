"""/object-states"""

from __future__ import annotations

from typing import Annotated, Any
from uuid import UUID

from fastapi import APIRouter, Query
from pydantic import ConfigDict, Field

from semap.model.object_state import NewObjectState
from semap.store.map.maps import get_map
from semap.store.motion import object_states
from semap_service.database.transaction import Database, Write, transaction
from semap_service.documents.document import (
    After,
    Document,
    InStamp,
    Limit,
    MapFilter,
    Name,
    Next,
    Request,
    Stamp,
    next_after,
)
from semap_service.http.problem import problems

router = APIRouter(tags=["object states"])

MOST_STATES = 1000

Attributes = Annotated[dict[str, Any], Field(description="Further data of the source.")]


class ObjectStateDocument(Document):
    """A property of an instance has a value from a stamp on."""

    id: int = Field(description="In the order of arrival.")
    uid: UUID = Field(description="The same for the same state, however often it is sent.")
    map: str
    source: str
    instance_id: int
    instance: str
    property: str
    value: str
    previous: str | None = Field(
        description="The value before, as far as known when this one arrived; null for the first."
    )
    stamp: Stamp
    since: Stamp | None = Field(description="When the value before began.")
    attributes: Attributes


class ObjectStateList(Document):
    object_states: list[ObjectStateDocument] = Field(description="In the order of their arrival.")
    next: Next


class NewObjectStateDocument(Request):
    """A property of an instance has a value from a stamp on."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"instance": "Door07", "property": "door", "value": "open", "stamp": "2026-01-31T12:00:00Z"}
            ]
        }
    )

    instance: Name = Field(description="Its name on the map.")
    property: Name
    value: Annotated[str, Field(max_length=1000, pattern=r"^[^\x00]*$")]
    stamp: InStamp
    attributes: Attributes = Field(default_factory=dict)


class NewObjectStates(Request):
    """States of objects from a source."""

    map: Name = Field(examples=["office"])
    source: Name = Field(description="Made where it is missing.", examples=["door contacts"])
    states: Annotated[list[NewObjectStateDocument], Field(max_length=MOST_STATES)]
    watermark: InStamp | None = Field(
        default=None,
        description="After these, the source gives no state up to this stamp, and rules may go on so far. A"
        " source that says no watermark has given all before its newest stamp, and all at it after a second"
        " of silence.",
    )


class AddedObjectStates(Document):
    added: int = Field(description="How many were not known before.")


@router.get("/object-states", operation_id="list_object_states", responses=problems(404))
def list_object_states(
    database: Database,
    map_name: MapFilter = None,
    instance: Annotated[Name | None, Query(description="Only of the instance of this name.")] = None,
    property_name: Annotated[
        Name | None, Query(alias="property", description="Only of the property of this name.")
    ] = None,
    limit: Limit = 100,
    after: After = 0,
) -> ObjectStateList:
    """States of objects, such as doors that opened and closed."""
    with transaction(database) as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = object_states.list_object_states(
            connection,
            map_name=map_name,
            instance=instance,
            property_name=property_name,
            after=after,
            limit=limit,
        )
    return ObjectStateList(
        object_states=[ObjectStateDocument.model_validate(each) for each in found],
        next=next_after([each.id for each in found], limit),
    )


@router.post("/object-states", operation_id="add_object_states", responses=problems(404))
def add_object_states(write: Write, new: NewObjectStates) -> AddedObjectStates:
    """Tell what a source saw of objects; all of it, or nothing where one cannot be.

    What was sent before is passed over, so that a request may be repeated.
    """
    states = [
        NewObjectState(each.instance, each.property, each.value, each.stamp, each.attributes)
        for each in new.states
    ]
    with write.to(new.map).begin() as connection:
        added = object_states.add_object_states(
            connection, new.map, new.source, states, watermark=new.watermark
        )
    return AddedObjectStates(added=len(added))
