"""/events, to be polled"""

from __future__ import annotations

import asyncio
import time
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import Field
from starlette.requests import Request

from semap.store.maps import get_map
from semap_service.document import LARGEST_ID, Document, Limit, MapFilter, Name
from semap_service.feed import Feed, Selection
from semap_service.problem import problems
from semap_service.routes.event_document import EventDocument, event_document
from semap_service.transaction import Database, transaction

router = APIRouter(tags=["events"])

LONGEST_WAIT_S = 60


class EventList(Document):
    events: list[EventDocument] = Field(description="In the order of their numbers.")
    next: int = Field(description="`after` of the next request, whether or not there was an event.")


@router.get("/events", operation_id="list_events", responses=problems(404))
async def list_events(
    request: Request,
    database: Database,
    after: Annotated[int, Query(ge=0, le=LARGEST_ID, description="Only events after this number.")] = 0,
    limit: Limit = 100,
    wait: Annotated[
        float,
        Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="Wait so long for an event [s]."),
    ] = 0,
    map_name: MapFilter = None,
    event_type: Annotated[Name | None, Query(alias="type", description="Only events of this type.")] = None,
    rule_name: Annotated[Name | None, Query(alias="rule", description="Only events of this rule.")] = None,
) -> EventList:
    """Events after a number, oldest first; with `wait` as soon as there is one.

    Events are also pushed over the WebSocket /events/feed with the same parameters `after`, `map`, `type`
    and `rule`: {"type": "hello", "cursor", "head"}, then {"type": "event", "cursor", "event"} for each, and
    {"type": "heartbeat", "cursor"} after 15 s of silence. Without `after` it begins with what comes.
    """
    deadline_s = time.monotonic() + wait
    feed: Feed = request.app.state.feed
    selection = Selection(map_name, event_type, rule_name)
    if map_name is not None:
        await asyncio.to_thread(_require_map, database, map_name)
    page = await asyncio.to_thread(feed.read_stored, after, limit, selection)
    while not page.events:
        left_s = deadline_s - time.monotonic()
        if left_s <= 0 or not await feed.wait(page.cursor, left_s):
            break
        page = await feed.read(page.cursor, limit, selection)
    return EventList(events=[event_document(each) for each in page.events], next=page.cursor)


def _require_map(database: Database, name: str) -> None:
    with transaction(database) as connection:
        get_map(connection, name)
