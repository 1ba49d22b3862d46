"""/events/stream: events as they happen, as server-sent events (WHATWG HTML, 9.2)."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Annotated, Any

from fastapi import APIRouter, Header, Query, Request, Response
from starlette.types import Receive, Scope, Send

from semap.errors import SemapError
from semap_service.database.transaction import Database
from semap_service.documents.document import LARGEST_ID
from semap_service.documents.feed import Failure
from semap_service.feed.encoding import StreamEncoding
from semap_service.feed.request import EnvelopeName, Wanted, cursor_of, envelope_of
from semap_service.feed.ring import Feed
from semap_service.feed.start_position import begin
from semap_service.feed.subscription import follow
from semap_service.http.connection import lent
from semap_service.http.outlet import NotTaken, Pace, StreamOutlet
from semap_service.http.problem import problems

router = APIRouter(tags=["events"])

STREAM = "text/event-stream"
HEADERS = {
    "Content-Type": STREAM,  # always UTF-8, so that no charset is said
    "Cache-Control": "no-store, no-transform",
    "X-Accel-Buffering": "no",  # for nginx, which would keep messages back
}


class EventStream(Response):
    """An answer that goes on until its client has gone, the server stops, or what writes it is done."""

    def __init__(self, write: Callable[[StreamOutlet], Awaitable[None]]) -> None:
        super().__init__(headers=HEADERS)
        del self.headers["content-length"]
        self._write = write

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": self.raw_headers})
        connection = lent(Request(scope))
        tasks: list[asyncio.Future[Any]] = [
            asyncio.ensure_future(_gone(receive)),
            asyncio.ensure_future(self._write(StreamOutlet(send, connection))),
        ]
        if connection is not None:
            tasks.append(asyncio.ensure_future(connection.stopping.wait()))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task
        await send({"type": "http.response.body", "body": b"", "more_body": False})


@router.get(
    "/events/stream",
    operation_id="stream_events",
    status_code=200,
    response_class=EventStream,
    responses={
        200: {
            "description": "A message for each event, whose `id` is its number.",
            "content": {STREAM: {"schema": {"type": "string"}}},
        },
        **problems(404),
    },
)
async def stream_events(
    request: Request,
    database: Database,
    wanted: Wanted,
    after: Annotated[
        int | None,
        Query(ge=0, le=LARGEST_ID, description="Begin after this number. [default: with what comes]"),
    ] = None,
    last_event_id: Annotated[
        str | None,
        Header(alias="Last-Event-ID", max_length=40, description="The same, and comes before `after`."),
    ] = None,
    envelope: EnvelopeName = None,
) -> Response:
    """Events as they are committed, as server-sent events.
    The first message is `hello`, with the outcome of resuming; then each event is a message without a name,
    its number as the `id`. A client that reconnects with `Last-Event-ID` resumes after that event. Without
    events, the stream sends comments. A client that reads too slowly gets `too_slow`, and the stream ends.
    """
    feed: Feed = request.app.state.feed
    begun = cursor_of(last_event_id, "Last-Event-ID") if last_event_id else after
    beginning = await feed.ask(partial(begin, database, begun, wanted))
    encoding = StreamEncoding(envelope_of(envelope, request))
    pace: Pace = request.app.state.pace

    async def write(outlet: StreamOutlet) -> None:
        with feed.following("sse"), request.app.state.channels.following(wanted, encoding) as channel:
            try:
                await follow(feed, channel, outlet, beginning, pace)
            except SemapError as error:
                failure = Failure(detail=str(error), remedy=error.remedy)
                with suppress(NotTaken):
                    await outlet.put(encoding.message(failure), pace.patience_s)

    return EventStream(write)


async def _gone(receive: Receive) -> None:
    """Return when the client has gone."""
    while (await receive())["type"] != "http.disconnect":
        pass
