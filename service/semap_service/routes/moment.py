"""/maps/{name}/moment, /timeline and /extent: a map as it was, and what happened between two moments"""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import Field

from semap.store.event import events
from semap.store.motion import moment
from semap.store.motion.tracks import get_track
from semap.timeline.stamp import EARLIEST, LATEST
from semap_service.context.caller import current_caller
from semap_service.database.transaction import Database, transaction
from semap_service.documents.document import Document, Id, InStamp, Limit, Stamp, require_order
from semap_service.documents.event import EventDocument
from semap_service.documents.live_map import ShownDoorDocument, ShownTrackDocument, track_values
from semap_service.http.problem import problems

router = APIRouter(tags=["history"])

From = Annotated[InStamp, Query(alias="from", description="The earlier moment (RFC 3339).")]
To = Annotated[InStamp, Query(alias="to", description="The later moment, included.")]


class PastTrackDocument(ShownTrackDocument):
    """Someone or something, as it was seen last by the moment, and how it came there."""

    trail: list[list[float]] = Field(
        description="x [m], y [m] and time [s, at most 0, from the moment on] of where it was, oldest first."
    )


class MomentDocument(Document):
    """A map at a moment, in the form of the snapshot of /maps/{name}/live."""

    type: Literal["snapshot"]
    stamp: Stamp
    tracks: list[PastTrackDocument]
    doors: list[ShownDoorDocument]
    rooms: dict[str, int] = Field(description="How many tracks were in each instance, by its id.")
    event_cursor: int = Field(description="Number of the newest event by then; 0 where there was none.")
    change_set: int = Field(description="The newest change of the map until now; 0 where there was none.")


class StayDocument(Document):
    """A track was in the room."""

    track_id: int
    name: str
    from_: Stamp = Field(serialization_alias="from")
    to: Stamp | None = Field(description="null while it holds.")


class RoomTimeline(Document):
    instance_id: int
    name: str = Field(examples=["Room07"])
    stays: list[StayDocument] = Field(description="In the order in which they began.")


class RoomStayDocument(Document):
    """The track was in the room."""

    instance_id: int
    name: str = Field(description="Of the room, as it is now or was last.", examples=["Room07"])
    from_: Stamp = Field(serialization_alias="from")
    to: Stamp | None = Field(description="null while it holds.")


class RoomStayList(Document):
    """Where a track was, also after its end."""

    stays: list[RoomStayDocument] = Field(description="The last first.")
    more: bool = Field(description="Whether `limit` left out earlier ones.")


class DoorStateDocument(Document):
    """The door stood so."""

    state: str = Field(examples=["open"])
    from_: Stamp = Field(serialization_alias="from")
    to: Stamp | None = Field(description="null while it holds.")


class DoorTimeline(Document):
    instance_id: int
    name: str = Field(examples=["Door07"])
    states: list[DoorStateDocument] = Field(description="In the order in which they began.")


class TimelineDocument(Document):
    """Occupancy of rooms, states of doors, and events."""

    from_: Stamp = Field(serialization_alias="from")
    to: Stamp
    rooms: list[RoomTimeline] = Field(description="Rooms with occupants, by their ids.")
    doors: list[DoorTimeline] = Field(description="Doors with states, by their ids.")
    events: list[EventDocument] = Field(description="In the order of their stamps.")
    more: bool = Field(description="Whether `limit` truncated the result: request a shorter time.")


class ExtentDocument(Document):
    """When there is something to look back at."""

    first: Stamp | None = Field(description="null where the map has no data.")
    last: Stamp | None


@router.get("/maps/{name}/moment", operation_id="get_moment", responses=problems(404))
def get_moment(
    database: Database,
    name: str,
    at: Annotated[InStamp, Query(description="Event time (RFC 3339).")],
    trail_s: Annotated[
        float, Query(ge=0, le=300, allow_inf_nan=False, description="How far back trails go [s].")
    ] = 10,
    within_s: Annotated[
        float,
        Query(
            gt=0,
            le=600,
            allow_inf_nan=False,
            description="A track outside of all rooms is there if it was seen so long before [s].",
        ),
    ] = 10,
) -> MomentDocument:
    """Positions of tracks, states of doors and occupancy of rooms, as of an event time.
    Trails have at most 200 points. The former state of the map itself is in its history.
    """
    with transaction(database) as connection:
        then = moment.moment(
            connection, name, at, trail_s=trail_s, within_s=within_s, own=current_caller().maps is not None
        )
    return MomentDocument(
        type="snapshot",
        stamp=at,
        tracks=[PastTrackDocument(**track_values(each), trail=each.trail) for each in then.tracks],
        doors=[ShownDoorDocument.model_validate(each) for each in then.doors],
        rooms={str(instance_id): count for instance_id, count in then.occupants.items()},
        event_cursor=then.event_cursor,
        change_set=then.change_set,
    )


@router.get("/maps/{name}/timeline", operation_id="get_timeline", responses=problems(404))
def get_timeline(
    database: Database,
    name: str,
    start: From,
    end: To,
    limit: Annotated[
        int, Query(ge=1, le=10_000, description="At most so many stays, states and events each.")
    ] = 1000,
) -> TimelineDocument:
    """Occupancy of rooms, states of doors and events between two moments."""
    require_order(start, end)
    with transaction(database) as connection:
        stays = moment.stays(connection, name, start, end, limit + 1)
        states = moment.door_states(connection, name, start, end, limit + 1)
        happened = events.list_events_between(
            connection, name, start, end, limit=limit + 1, own=current_caller().maps is not None
        )
    more = max(len(stays), len(states), len(happened)) > limit
    return TimelineDocument(
        from_=start,
        to=end,
        rooms=_rooms(stays[:limit]),
        doors=_doors(states[:limit]),
        events=[EventDocument.model_validate(each) for each in happened[:limit]],
        more=more,
    )


@router.get("/tracks/{id}/stays", operation_id="list_stays_of_track", responses=problems(404))
def list_stays_of_track(
    database: Database,
    id: Id,  # noqa: A002
    start: Annotated[
        InStamp,
        Query(alias="from", description="Held after it (RFC 3339). [default: the beginning]"),
    ] = EARLIEST,
    end: Annotated[
        InStamp, Query(alias="to", description="Began by then (RFC 3339). [default: now]")
    ] = LATEST,
    limit: Limit = 100,
) -> RoomStayList:
    """In which rooms this track was and when, also after its end."""
    require_order(start, end)
    with transaction(database) as connection:
        get_track(connection, id)
        found = moment.stays_of_track(connection, id, start, end, limit + 1)
    return RoomStayList(
        stays=[
            RoomStayDocument(
                instance_id=each.instance_id, name=each.instance, from_=each.since, to=each.until
            )
            for each in found[:limit]
        ],
        more=len(found) > limit,
    )


@router.get("/maps/{name}/extent", operation_id="get_extent", responses=problems(404))
def get_extent(database: Database, name: str) -> ExtentDocument:
    """The first and the last stamp of all states, relations and events of a map."""
    with transaction(database) as connection:
        found = moment.extent(connection, name)
    first, last = found or (None, None)
    return ExtentDocument(first=first, last=last)


def _rooms(stays: tuple[moment.Stay, ...]) -> list[RoomTimeline]:
    found: dict[int, RoomTimeline] = {}
    for each in stays:
        room = found.setdefault(
            each.instance_id, RoomTimeline(instance_id=each.instance_id, name=each.instance, stays=[])
        )
        room.stays.append(
            StayDocument(track_id=each.track_id, name=each.track, from_=each.since, to=each.until)
        )
    return [found[instance_id] for instance_id in sorted(found)]


def _doors(states: tuple[moment.DoorState, ...]) -> list[DoorTimeline]:
    found: dict[int, DoorTimeline] = {}
    for each in states:
        door = found.setdefault(
            each.instance_id, DoorTimeline(instance_id=each.instance_id, name=each.door, states=[])
        )
        door.states.append(DoorStateDocument(state=each.state, from_=each.since, to=each.until))
    return [found[instance_id] for instance_id in sorted(found)]
