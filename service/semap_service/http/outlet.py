"""Where a client's messages go: a WebSocket, or the body of an answer."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Protocol

from starlette.types import Send
from starlette.websockets import WebSocket

from semap_service.http.connection import Connection, lent
from semap_service.http.websocket import text_of

PATIENCE_S = 10.0
MOST_BEHIND = 10_000


@dataclass(frozen=True)
class Pace:
    """How fast a client has to be, and after how much silence it is told that the connection is alive."""

    heartbeat_s: float
    patience_s: float = PATIENCE_S
    most_behind: int = MOST_BEHIND


class NotTaken(Exception):
    """The client did not take what it was sent in time."""


class Outlet(Protocol):
    """One client. `ready` comes before each `put`."""

    async def ready(self, patience_s: float) -> None:
        """Return when the client has taken most of what it was sent.

        raises  NotTaken
        """

    async def put(self, written: bytes, patience_s: float) -> None:
        """Send a message.

        raises  NotTaken
        """

    def let_pass(self) -> None:
        """Let a last message be put that the client may or may not take; its connection ends soon."""


class SocketOutlet:
    """Frames, written as they are to a connection that is lent; else through ASGI."""

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket
        self._lent = lent(socket)

    async def ready(self, patience_s: float) -> None:
        await _drained(self._lent, patience_s)

    async def put(self, written: bytes, patience_s: float) -> None:
        if self._lent is not None:
            if not self._lent.transport.is_closing():
                self._lent.transport.write(written)
            return
        async with _patience(patience_s):
            await self._socket.send_text(text_of(written))

    def let_pass(self) -> None:
        _let_pass(self._lent)


class StreamOutlet:
    """Parts of the body of an answer."""

    def __init__(self, send: Send, connection: Connection | None) -> None:
        self._send = send
        self._lent = connection

    async def ready(self, patience_s: float) -> None:
        await _drained(self._lent, patience_s)

    async def put(self, written: bytes, patience_s: float) -> None:
        message = {"type": "http.response.body", "body": written, "more_body": True}
        if self._lent is not None:
            await self._send(message)
            return
        async with _patience(patience_s):
            await self._send(message)

    def let_pass(self) -> None:
        _let_pass(self._lent)


async def _drained(connection: Connection | None, patience_s: float) -> None:
    if connection is not None and connection.is_full():
        async with _patience(patience_s):
            await connection.drained()


def _let_pass(connection: Connection | None) -> None:
    if connection is not None:
        connection.let_pass()
        connection.drop_unless_taken()


@asynccontextmanager
async def _patience(patience_s: float) -> AsyncIterator[None]:
    try:
        async with asyncio.timeout(patience_s):
            yield
    except TimeoutError as error:
        raise NotTaken from error
