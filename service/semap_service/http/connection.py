"""Connections as the feeds need them, lent by uvicorn through an extension of the ASGI scope.

ASGI says when a message was handed over, but not how much of it the client has yet to take, it cannot drop a
client that takes nothing, and it writes each message for each client anew. So semap's protocols for uvicorn
lend the transport to the application under `EXTENSION`. Where another server runs the application, nothing is
lent, and the feeds make do with plain ASGI.

Little may wait in the kernel unsent (TCP_NOTSENT_LOWAT), so that a client that does not read is noticed soon
and holds little memory.
"""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

from starlette.requests import HTTPConnection
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

from semap_service.http.request_head import TimelyHead, cut_off, refuse

EXTENSION = "semap.connection"
UNSENT_BYTES = 128 * 1024
UNSENT_STATE_BYTES = 16 * 1024
CLOSE_S = 5.0


@dataclass
class Connection:
    """What is lent of a connection.

    drained   returns when the client has taken most of what was written
    is_full   whether it has not
    let_pass  lets one more message be written all the same
    stopping  set when the server is about to stop
    """

    transport: asyncio.Transport
    drained: Callable[[], Awaitable[object]]
    is_full: Callable[[], bool]
    let_pass: Callable[[], None]
    stopping: asyncio.Event = field(default_factory=asyncio.Event)

    def keep_newest(self) -> None:
        """Let as little as possible wait, since what waits is overtaken."""
        self.transport.set_write_buffer_limits(high=0)
        _keep_unsent(self.transport, UNSENT_STATE_BYTES)

    def drop_unless_taken(self) -> None:
        """Cut the connection off if the client does not take what is written within some seconds."""
        asyncio.get_running_loop().call_later(CLOSE_S, self._drop)

    def _drop(self) -> None:
        if self.transport.get_write_buffer_size() > 0:
            cut_off(self.transport)


def lent(connection: HTTPConnection) -> Connection | None:
    """What the server lends of the connection of a request, if it is semap's own."""
    found: Connection | None = connection.scope.get("extensions", {}).get(EXTENSION)
    return found


class HttpConnection(TimelyHead):
    """HTTP/1.1 that lends its connection."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        _keep_unsent(transport, UNSENT_BYTES)
        self.lent = Connection(
            transport,
            self.flow.drain,
            lambda: self.flow.write_paused,
            self.flow.resume_writing,
        )

    def on_message_begin(self) -> None:
        super().on_message_begin()
        scope: dict[str, Any] = self.scope  # type: ignore[assignment]
        scope["extensions"] = {EXTENSION: self.lent}

    def shutdown(self) -> None:
        self.lent.stopping.set()
        super().shutdown()


class WebSocketConnection(WebSocketsSansIOProtocol):
    """A WebSocket that lends its connection."""

    def handle_connect(self, event: Request) -> None:
        super().handle_connect(event)
        if self.response.status_code == 101:
            extensions: dict[str, Any] = self.scope["extensions"]
            extensions[EXTENSION] = Connection(
                self.transport,
                self.writable.wait,
                lambda: not self.writable.is_set(),
                self.writable.set,
            )

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if not self.handshake_initiated and not self.transport.is_closing():  # which uvicorn would leave open
            refuse(self.transport, HTTPStatus.BAD_REQUEST, "This is no upgrade to a WebSocket.")


def _keep_unsent(transport: asyncio.Transport, most_bytes: int) -> None:
    made: socket.socket | None = transport.get_extra_info("socket")
    option = getattr(socket, "TCP_NOTSENT_LOWAT", None)
    if made is not None and option is not None and made.family in (socket.AF_INET, socket.AF_INET6):
        made.setsockopt(socket.IPPROTO_TCP, option, most_bytes)
