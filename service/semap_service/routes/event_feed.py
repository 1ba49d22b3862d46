"""The WebSocket /events/feed: events as they happen.

Messages are sent one after another, the next only when the socket has taken the one before, so that a
slow client holds nothing but its own cursor. What the client sends is not looked at.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from semap.errors import CallerError, InvalidInput, SemapError
from semap.store.events import newest_event
from semap.store.maps import get_map
from semap_service.document import LARGEST_ID
from semap_service.feed import Feed, Selection
from semap_service.routes.event_document import event_document
from semap_service.transaction import Database, transaction

router = APIRouter()

PAGE = 200
BAD_REQUEST = 4400
TRY_AGAIN = 1013


@router.websocket("/events/feed")
async def event_feed(socket: WebSocket, database: Database) -> None:
    """Hello, then every selected event after the cursor in order, and heartbeats in between."""
    await socket.accept()
    try:
        selection = Selection(*(socket.query_params.get(name) for name in ("map", "type", "rule")))
        after = _cursor(socket.query_params.get("after"))
        cursor, head = await asyncio.to_thread(_begin, database, after, selection)
        await socket.send_json({"type": "hello", "cursor": cursor, "head": head})
        await _push(socket, cursor, selection)
    except CallerError as error:
        await _refuse(socket, BAD_REQUEST, error)
    except SemapError as error:
        await _refuse(socket, TRY_AGAIN, error)
    except WebSocketDisconnect:
        return


async def _push(socket: WebSocket, cursor: int, selection: Selection) -> None:
    feed: Feed = socket.app.state.feed
    heartbeat_s: float = socket.app.state.heartbeat_s
    gone = asyncio.create_task(_gone(socket))
    sent_s = time.monotonic()
    try:
        while not gone.done():
            page = await feed.read(cursor, PAGE, selection)
            for event in page.events:
                document = event_document(event).model_dump(mode="json")
                await socket.send_json({"type": "event", "cursor": event.seq, "event": document})
                sent_s = time.monotonic()
            cursor = page.cursor
            if page.is_full:
                continue
            if time.monotonic() - sent_s >= heartbeat_s:
                await socket.send_json({"type": "heartbeat", "cursor": cursor})
                sent_s = time.monotonic()
            await _news_or_gone(feed, cursor, sent_s + heartbeat_s - time.monotonic(), gone)
    finally:
        gone.cancel()
        with suppress(asyncio.CancelledError):
            await gone


async def _news_or_gone(feed: Feed, cursor: int, timeout_s: float, gone: asyncio.Task[None]) -> None:
    news = asyncio.create_task(feed.wait(cursor, timeout_s))
    try:
        await asyncio.wait({news, gone}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        news.cancel()


async def _gone(socket: WebSocket) -> None:
    """Return when the client has gone."""
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass


def _cursor(text: str | None) -> int | None:
    if text is None:
        return None
    if not (text.isascii() and text.isdigit()) or int(text[:20]) > LARGEST_ID:
        raise InvalidInput(f"{text[:40]!r} is no number of an event", "Give a whole number from 0.", "after")
    return int(text)


def _begin(database: Database, after: int | None, selection: Selection) -> tuple[int, int]:
    """The cursor to begin at, and the number of the newest event."""
    with transaction(database) as connection:
        if selection.map is not None:
            get_map(connection, selection.map)
        head = newest_event(connection)
    if after is not None and after > head:
        raise InvalidInput(
            f"{after} is beyond the newest event, {head}",
            "The database is another one, or was restored: begin again without a cursor.",
            "after",
        )
    return (head if after is None else after), head


async def _refuse(socket: WebSocket, code: int, error: SemapError) -> None:
    with suppress(WebSocketDisconnect, RuntimeError):
        await socket.send_json({"type": "error", "detail": str(error), "remedy": error.remedy})
        await socket.close(code, str(error).encode()[:120].decode(errors="ignore"))
