"""WebSockets as the service holds them: accepted, refused and closed; and text frames (RFC 6455, 5.2)."""

from __future__ import annotations

import asyncio
import struct
from contextlib import suppress

from fastapi import WebSocket, WebSocketDisconnect

from semap.errors import CallerError, SemapError
from semap_service.documents.feed import Failure

FINAL_TEXT = 0x81
PROTOCOL = "semap"
BAD_REQUEST = 4400
TOO_SLOW = 4408
TRY_AGAIN = 1013


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


def text_frame(payload: bytes) -> bytes:
    """A whole text message as the server sends it (RFC 6455, 5.2)."""
    return header(len(payload)) + payload


def text_of(frame: bytes) -> str:
    """What a text frame says."""
    code = frame[1]
    return frame[{126: 4, 127: 10}.get(code, 2) :].decode()


def header(length: int) -> bytes:
    if length < 126:
        return struct.pack("!BB", FINAL_TEXT, length)
    if length < 1 << 16:
        return struct.pack("!BBH", FINAL_TEXT, 126, length)
    return struct.pack("!BBQ", FINAL_TEXT, 127, length)
