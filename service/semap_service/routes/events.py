"""/events, to be polled, and what describes events and feeds: /schemas/event, /asyncapi.json"""

from __future__ import annotations

import asyncio
import time
from functools import partial
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Response
from fastapi.responses import JSONResponse
from pydantic import Field, TypeAdapter
from starlette.requests import HTTPConnection, Request

from semap_service.access.caller import current_caller
from semap_service.asyncapi import asyncapi
from semap_service.cloud_event import BATCH, CloudEventDocument, schema_url
from semap_service.document import LARGEST_ID, Document, Limit, MapFilter, Name
from semap_service.feed import Feed, Page, Selection
from semap_service.feed.beginning import begin
from semap_service.feed.connection import Connection, lent
from semap_service.feed.form import Envelope
from semap_service.problem import problems
from semap_service.routes.event_document import EventDocument
from semap_service.transaction import Database

router = APIRouter(tags=["events"])

LONGEST_WAIT_S = 60
LONGEST_SEARCH_S = 2.0
"""How long one request looks for the first event that a filter takes."""
SCHEMA = "application/schema+json"

REFERENCES = "#/components/schemas/{model}"

EnvelopeName = Annotated[
    Literal["cloudevents"] | None,
    Query(description="Give each event as a CloudEvents 1.0 object (JSON format)."),
]


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


def _wanted(
    map_name: MapFilter = None,
    event_type: Annotated[Name | None, Query(alias="type", description="Only events of this type.")] = None,
    rule_name: Annotated[Name | None, Query(alias="rule", description="Only events of this rule.")] = None,
    filter: Annotated[  # noqa: A002
        str | None,
        Query(
            min_length=1,
            max_length=8000,
            description="Only events that match this CQL2 text. Properties: seq, map, type, rule,"
            " rule_version, track, track_id, instance, instance_id, stamp, since, cause, confidence,"
            " by_batch, verdict, place (where its track was then, or else its instance is, in the map"
            " frame), and for key.NAME, measures.NAME and payload.NAME (either of the two).",
            examples=["instance = 'Room07' AND measures.gap_s < 2"],
        ),
    ] = None,
) -> Selection:
    return Selection(map_name, event_type, rule_name, filter, current_caller().maps)


Wanted = Annotated[Selection, Depends(_wanted)]


def envelope_of(name: str | None, connection: HTTPConnection) -> Envelope:
    """How a client wants its events."""
    return Envelope(None if name is None else schema_url(connection))


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
