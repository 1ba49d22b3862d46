"""The WebSocket /events/feed: events as they happen.

What the client sends is not looked at.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from contextlib import suppress
from functools import partial

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from semap.errors import CallerError, InvalidInput, SemapError
from semap_service.access.caller import current_caller
from semap_service.cloud_event import schema_url
from semap_service.feed import Feed, Selection
from semap_service.feed.beginning import begin, cursor_of
from semap_service.feed.form import Envelope, SocketForm
from semap_service.feed.message import Failure
from semap_service.feed.outlet import SocketOutlet
from semap_service.feed.subscription import Pace, follow
from semap_service.transaction import Database

router = APIRouter()

PROTOCOL = "semap"
BAD_REQUEST = 4400
TOO_SLOW = 4408
TRY_AGAIN = 1013


@router.websocket("/events/feed")
async def event_feed(socket: WebSocket, database: Database) -> None:
    """Hello, then every selected event after the cursor in order, and heartbeats in between."""
    await accept(socket)
    feed: Feed = socket.app.state.feed
    with feed.following("websocket"):
        try:
            parameters = socket.query_params
            selection = selection_of(parameters)
            after = cursor_of(parameters.get("after"), "after")
            envelope = _envelope(parameters.get("envelope"), socket)
            beginning = await feed.ask(partial(begin, database, after, selection))
            with socket.app.state.channels.following(selection, SocketForm(envelope)) as channel:
                pace: Pace = socket.app.state.pace
                following = follow(feed, channel, SocketOutlet(socket), beginning, pace)
                if await until_gone(socket, asyncio.create_task(following)):
                    await close(socket, TOO_SLOW, "too slow")
        except SemapError as error:
            await refuse(socket, error)


def selection_of(parameters: Mapping[str, str]) -> Selection:
    """What is selected by a query, among what the caller may see."""
    map_name, event_type, rule, text = (
        parameters.get(name) or None for name in ("map", "type", "rule", "filter")
    )
    return Selection(map_name, event_type, rule, text, current_caller().maps)


async def accept(socket: WebSocket) -> None:
    """Accept a WebSocket; a browser that gives its token as a subprotocol is answered with semap's name."""
    offered = socket.scope.get("subprotocols", ())
    await socket.accept(PROTOCOL if PROTOCOL in offered else None)


async def until_gone(socket: WebSocket, following: asyncio.Task[None]) -> bool:
    """Whether the task came to its end by itself, before the client had gone; it has ended then.

    raises  what the task raises
    """
    gone = asyncio.create_task(_gone(socket))
    try:
        await asyncio.wait({following, gone}, return_when=asyncio.FIRST_COMPLETED)
        if not following.done():
            return False
        with suppress(WebSocketDisconnect):
            following.result()
        return not gone.done()
    finally:
        for task in (following, gone):
            task.cancel()
            with suppress(asyncio.CancelledError, WebSocketDisconnect, SemapError):
                await task


async def refuse(socket: WebSocket, error: SemapError) -> None:
    """Tell a client what is wrong, and close."""
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.send_json(Failure(detail=str(error), remedy=error.remedy).model_dump())
    code = BAD_REQUEST if isinstance(error, CallerError) else TRY_AGAIN
    await close(socket, code, str(error))


async def close(socket: WebSocket, code: int, reason: str) -> None:
    """Close, and say why."""
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.close(code, reason.encode()[:120].decode(errors="ignore"))


async def _gone(socket: WebSocket) -> None:
    """Return when the client has gone."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass


def _envelope(name: str | None, socket: WebSocket) -> Envelope:
    if name in (None, "", "none"):
        return Envelope()
    if name != "cloudevents":
        raise InvalidInput(f"{name[:40]!r} is no envelope", "Leave it out, or give cloudevents.", "envelope")
    return Envelope(schema_url(socket))
