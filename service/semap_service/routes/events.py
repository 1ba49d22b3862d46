"""/events to be polled, /maps/{name}/events to be searched, and what describes them"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from fastapi.responses import JSONResponse
from pydantic import Field, TypeAdapter
from sqlalchemy import Engine
from starlette.requests import Request

from semap.errors import InvalidInput
from semap.store.event import event_search
from semap.store.event.cloud_event import BATCH
from semap.store.event.event_selection import Selection
from semap.store.event.events import StoredEvent, numbers_of
from semap.timeline.stamp import to_datetime, to_us
from semap_service.context.caller import current_caller
from semap_service.database.transaction import Database, Directory, transaction
from semap_service.documents.asyncapi import asyncapi
from semap_service.documents.cloud_event import CloudEventDocument, schema_url
from semap_service.documents.document import (
    LARGEST_ID,
    Document,
    InStamp,
    Limit,
    Name,
    Stamp,
    require_order,
)
from semap_service.documents.event import EventDocument
from semap_service.feed.request import EnvelopeName, Wanted, envelope_of
from semap_service.feed.ring import Feed, Page
from semap_service.feed.start_position import begin
from semap_service.http.connection import Connection, lent
from semap_service.http.problem import problems

router = APIRouter(tags=["events"])

LONGEST_WAIT_S = 60
LONGEST_SEARCH_S = 2.0
"""How long one request looks for the first event that a filter takes."""
SCHEMA = "application/schema+json"
CURSOR = r"^-?\d{1,17}\.\d{1,18}$"

REFERENCES = "#/components/schemas/{model}"


class AsyncApiDocument(Document):
    """A description of feeds (AsyncAPI 3.0)."""

    asyncapi: Literal["3.0.0"]
    info: dict[str, Any]
    defaultContentType: str
    servers: dict[str, Any]
    channels: dict[str, Any]
    operations: dict[str, Any]
    components: dict[str, Any]


class EventList(Document):
    events: list[EventDocument] = Field(description="In the order of their numbers.")
    next: int = Field(description="`after` of the next request, whether or not there was an event.")


class EventPage(Document):
    """Events of a map, found by what they are about."""

    events: list[EventDocument] = Field(description="The newest first.")
    next: str | None = Field(description="`before` of the next page; null where this is the last one.")
    reached: Stamp | None = Field(description="All events after it were looked at; null: all of the map.")


def _batch_schema() -> dict[str, Any]:
    """An array of CloudEvents; what they refer to stands among the schemas of /openapi.json."""
    schema = TypeAdapter(list[CloudEventDocument]).json_schema(mode="serialization", ref_template=REFERENCES)
    return {"type": "array", "items": schema["$defs"]["CloudEventDocument"]}


@router.get(
    "/events",
    operation_id="list_events",
    response_model=EventList,
    responses={200: {"content": {BATCH: {"schema": _batch_schema()}}}, **problems(404)},
)
async def list_events(
    request: Request,
    database: Database,
    wanted: Wanted,
    after: Annotated[int, Query(ge=0, le=LARGEST_ID, description="Only events after this number.")] = 0,
    limit: Limit = 100,
    wait: Annotated[
        float,
        Query(ge=0, le=LONGEST_WAIT_S, allow_inf_nan=False, description="Wait so long for an event [s]."),
    ] = 0,
    envelope: EnvelopeName = None,
) -> Response:
    """Events after a number, oldest first; with `wait` as soon as there is one.

    Go on at `next`; with `envelope=cloudevents` the answer is a batch, and the next request is in the
    header Link. Events are also pushed: as server-sent events at /events/stream, and over the WebSocket
    /events/feed, with the same parameters; /asyncapi.json describes these.
    """
    feed: Feed = request.app.state.feed
    await feed.ask(partial(begin, database, after, wanted))
    with feed.following("poll"):
        page = await _first_found(feed, after, limit, wanted, wait, lent(request))
    written = envelope_of(envelope, request)
    events = b",".join(written.written(entry) for entry in page.entries)
    following = request.url.include_query_params(after=page.cursor)
    links = {"Link": f'<{following.path}?{following.query}>; rel="next"'}
    if envelope is None:
        body = b'{"events":[%b],"next":%d}' % (events, page.cursor)
        return Response(body, media_type="application/json", headers=links)
    return Response(b"[%b]" % events, media_type=BATCH, headers=links)


@router.get("/maps/{name}/events", operation_id="search_events", responses=problems(404))
def search_events(
    database: Database,
    directory: Directory,
    name: str,
    start: Annotated[
        InStamp | None, Query(alias="from", description="Only events from this stamp on (RFC 3339).")
    ] = None,
    end: Annotated[
        InStamp | None, Query(alias="to", description="Only events up to this stamp (RFC 3339).")
    ] = None,
    event_type: Annotated[Name | None, Query(alias="type", description="Only events of this type.")] = None,
    track: Annotated[Name | None, Query(description="Only events about the track of this name.")] = None,
    instance: Annotated[
        Name | None, Query(description="Only events about the instance of this name.")
    ] = None,
    text: Annotated[
        Name | None,
        Query(description="Only events with each of these words in the type, the rule, a name or a value."),
    ] = None,
    before: Annotated[
        str | None, Query(pattern=CURSOR, description="Go on there: `next` of the page before.")
    ] = None,
    limit: Limit = 100,
) -> EventPage:
    """Events of a map in the order of their stamps, the newest first.

    One request looks among 10,000 events for those that are wanted: a page may have none, and a `next`.
    """
    if start is not None and end is not None:
        require_order(start, end)
    wanted = event_search.Wanted(start, end, event_type, track, instance, text)
    with transaction(database) as connection:
        found = event_search.search_events(
            connection,
            name,
            wanted,
            before=None if before is None else _place(before),
            limit=limit,
            own=current_caller().maps is not None,
        )
    last = found.last
    return EventPage(
        events=[EventDocument.model_validate(each) for each in _numbered(found.events, database, directory)],
        next=None if last is None else f"{to_us(last.stamp)}.{last.number}",
        reached=None if last is None else last.stamp,
    )


@router.get(
    "/schemas/event",
    operation_id="get_event_schema",
    responses={200: {"content": {SCHEMA: {"schema": {"type": "object"}}}}, **problems()},
    response_class=Response,
)
def get_event_schema(request: Request) -> Response:
    """The JSON Schema of an event, which CloudEvents name as their `dataschema`."""
    document = EventDocument.model_json_schema(mode="serialization")
    return Response(
        TypeAdapter(dict[str, Any]).dump_json(
            {
                "$schema": "https://json-schema.org/draft/2020-12/schema",
                "$id": schema_url(request),
                **document,
            }
        ),
        media_type=SCHEMA,
    )


@router.get(
    "/asyncapi.json",
    operation_id="get_asyncapi",
    response_model=AsyncApiDocument,
    responses=problems(),
)
def get_asyncapi(request: Request) -> Response:
    """The messages of the feeds (AsyncAPI 3.0)."""
    return JSONResponse(asyncapi(request.url.netloc, secure=request.url.scheme == "https"))


def _numbered(events: Sequence[StoredEvent], database: Engine, directory: Engine) -> Sequence[StoredEvent]:
    """Events with the numbers that the feed gives them, which are those of the directory of shards."""
    if database is directory or current_caller().maps is not None:
        return events
    with transaction(directory) as connection:
        numbers = numbers_of(connection, {each.event_id for each in events})
    return [replace(each, seq=numbers.get(each.event_id, 0)) for each in events]


def _place(cursor: str) -> event_search.Place:
    stamp_us, number = map(int, cursor.split("."))
    try:
        return event_search.Place(to_datetime(stamp_us), number)
    except OverflowError as error:
        raise InvalidInput("it is no cursor", "Give `next` of the page before.", "before") from error


async def _first_found(
    feed: Feed, after: int, limit: int, wanted: Selection, wait_s: float, connection: Connection | None
) -> Page:
    """The page after a cursor; without events only where none was found in the time that there is."""
    begun_s = time.monotonic()
    page = await feed.read_past(after, limit, wanted)
    while not page.entries:
        now_s = time.monotonic()
        if page.is_full:
            if now_s > begun_s + LONGEST_SEARCH_S:
                break
        elif not await _news(feed, page.cursor, begun_s + wait_s - now_s, wanted, connection):
            break
        page = await feed.read(page.cursor, limit, wanted)
        await asyncio.sleep(0)
    return page


async def _news(
    feed: Feed, cursor: int, timeout_s: float, wanted: Selection, connection: Connection | None
) -> bool:
    """Whether there are events after a cursor before the time is over, or the server stops."""
    waiting = [asyncio.ensure_future(feed.wait(cursor, timeout_s, wanted))]
    if connection is not None:
        waiting.append(asyncio.ensure_future(connection.stopping.wait()))
    try:
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        return waiting[0].done() and waiting[0].result()
    finally:
        for each in waiting:
            each.cancel()
