"""How long, and how large, the head of a request may be, and how long an answer may go untaken.

uvicorn waits for the end of a head without end, and keeps what it has of it; so 50 sockets that send half a
head are 50 sockets for ever. Here each connection has `head_s` from its beginning, or from the first byte of
its next request, to the end of the head, and HEAD_BYTES for it. What cannot be parsed is answered as all
other errors are. A client that takes nothing of an answer for `take_s` is cut off.
"""

from __future__ import annotations

import asyncio
import socket
import struct
from http import HTTPStatus

from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol
from websockets import http11

from semap_service.http.problem import problem_response
from semap_service.http.security_headers import DEFAULTS

HEAD_BYTES = 64 * 1024
"""More than `access.authorisation` accepts, so that a head that is a little too long is answered there."""

AT_ONCE = struct.pack("ii", 1, 0)

# WebSocket upgrades are parsed once more, with limits of their own: a longer line would be left unanswered.
http11.MAX_LINE_LENGTH = http11.MAX_NUM_HEADERS = HEAD_BYTES


class TimelyHead(HttpToolsProtocol):
    """HTTP/1.1 with an end to how long a head is waited for, and an answer.

    head_s  until the head of a request has arrived
    take_s  within which a client takes something of what waits for it
    """

    head_s = 10.0
    take_s = 30.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.url = b""
        self._head_bytes = 0
        self._in_body = False
        self._untaken_bytes = 0
        self._taking: asyncio.TimerHandle | None = None
        self._heading: asyncio.TimerHandle | None = self.loop.call_later(self.head_s, self._head_is_late)

    def connection_lost(self, exc: Exception | None) -> None:
        self._end_timers()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        if self._heading is None and (self.cycle is None or self.cycle.response_complete):
            self._head_bytes = 0
            self._heading = self.loop.call_later(self.head_s, self._head_is_late)
        # what is left of a body whose answer is written already is no head
        self._head_bytes += 0 if self._in_body else len(data)
        super().data_received(data)
        if self._heading is not None and self._head_bytes > HEAD_BYTES and not self.transport.is_closing():
            self._refuse_long()

    def on_headers_complete(self) -> None:
        self._end_heading()
        self._in_body = True
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        self._in_body = False
        self._end_heading()
        super().on_message_complete()

    def handle_websocket_upgrade(self) -> None:
        self._end_timers()
        if len(self.url) > HEAD_BYTES // 2 or self._head_bytes > HEAD_BYTES:
            self._refuse_long()
        else:
            super().handle_websocket_upgrade()

    def send_400_response(self, msg: str) -> None:
        if len(self.url) > HEAD_BYTES // 2:
            self._refuse_long()
        else:
            refuse(self.transport, HTTPStatus.BAD_REQUEST, "This is no request of HTTP/1.1.")

    def pause_writing(self) -> None:
        super().pause_writing()
        self._untaken_bytes = self.transport.get_write_buffer_size()
        self._taking = self.loop.call_later(self.take_s, self._look_whether_taken)

    def resume_writing(self) -> None:
        super().resume_writing()
        self._end_taking()

    def _head_is_late(self) -> None:
        self._heading = None
        if self.transport.is_closing():
            return
        if self._head_bytes == 0 and not self._in_body:
            self.transport.close()  # opened beforehand, as browsers do
        else:
            detail = f"The head of the request did not arrive within {self.head_s:g} s."
            refuse(self.transport, HTTPStatus.REQUEST_TIMEOUT, detail)

    def _refuse_long(self) -> None:
        if len(self.url) > HEAD_BYTES // 2:
            refuse(self.transport, HTTPStatus.REQUEST_URI_TOO_LONG, "The URL is too long.")
        else:
            refuse(self.transport, HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, "The headers are too large.")

    def _look_whether_taken(self) -> None:
        untaken_bytes = self.transport.get_write_buffer_size()
        if untaken_bytes >= self._untaken_bytes:
            cut_off(self.transport)
            return
        self._untaken_bytes = untaken_bytes
        self._taking = self.loop.call_later(self.take_s, self._look_whether_taken)

    def _end_timers(self) -> None:
        self._end_heading()
        self._end_taking()

    def _end_heading(self) -> None:
        if self._heading is not None:
            self._heading.cancel()
            self._heading = None

    def _end_taking(self) -> None:
        if self._taking is not None:
            self._taking.cancel()
            self._taking = None


def refuse(transport: asyncio.Transport, status: HTTPStatus, detail: str) -> None:
    """Answer what never became a request, and close."""
    problem = problem_response("", status, detail, headers={**DEFAULTS, "Connection": "close"})
    head = b"".join(b"%b: %b\r\n" % each for each in problem.raw_headers)
    transport.write(STATUS_LINE[status] + head + b"\r\n" + bytes(problem.body))
    transport.close()


def cut_off(transport: asyncio.Transport) -> None:
    """Close at once; what the kernel still has is forgotten too, instead of being offered for minutes."""
    transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, AT_ONCE)
    transport.abort()
