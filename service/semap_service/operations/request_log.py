"""The outermost layer of the service: each request gets its id, is counted, and is written to the log.

What nothing inside has translated is answered here, so that this answer too has the id and is counted.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import dataclass, field

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from semap_service.context.request_id import CURRENT, HEADER, IDENTITY, request_id
from semap_service.http.security_headers import secure
from semap_service.operations.instruments import OTHER, Instruments

log = logging.getLogger("semap_service.access")

QUIET = frozenset({"/health", "/ready", "/metrics"})
"""Asked every few seconds by machines: said at the level debug."""

SWITCHING_PROTOCOLS = 101
INTERNAL_ERROR = 1011
CLIENT_CLOSED = 499
"""The client went before it was answered; no status of HTTP, but what servers usually write."""

ROUTE = "semap_route"
STARTS = ("http.response.start", "websocket.accept", "websocket.http.response.start")

Failure = Callable[[Request, Exception], Awaitable[Response]]


@dataclass
class Observed:
    """Mutable: what is known of a request while it is answered."""

    started_s: float = field(default_factory=time.monotonic)
    status: int | None = None
    is_stream: bool = False

    def see(self, message: Message) -> None:
        match message["type"]:
            case "http.response.start":
                self.status = message["status"]
                kind = dict(message.get("headers", ())).get(b"content-type", b"")
                self.is_stream = kind.startswith(b"text/event-stream")
            case "websocket.accept":
                self.status, self.is_stream = SWITCHING_PROTOCOLS, True
            case "websocket.close" if self.status is None:
                self.status = 403
            case "websocket.http.response.start":
                self.status = message["status"]


class RequestLog:
    """Wraps the whole service; `failed` makes the answer to an error that nobody expected."""

    def __init__(self, app: ASGIApp, instruments: Instruments, failed: Failure) -> None:
        self.app = app
        self.instruments = instruments
        self.failed = failed

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        identity: str = scope.get(IDENTITY) or request_id(dict(scope["headers"]))
        observed = Observed()

        async def answer(message: Message) -> None:
            observed.see(message)
            if message["type"] in STARTS:
                message.setdefault("headers", [])
                secure(message)
                MutableHeaders(scope=message)[HEADER] = identity
            await send(message)

        scope.setdefault("state", {})
        context = CURRENT.set(identity)
        try:
            with self.instruments.open_requests.track_inprogress():
                try:
                    await self.app(scope, receive, answer)
                except Exception as error:
                    await self._fail(scope, receive, answer, observed, error)
        finally:
            self._say(scope, observed)
            CURRENT.reset(context)

    async def _fail(
        self, scope: Scope, receive: Receive, answer: Send, observed: Observed, error: Exception
    ) -> None:
        if scope["type"] == "websocket":
            log.error("The socket %s failed", scope["path"], exc_info=error)
            with suppress(Exception):  # it may be closed already, in ways that differ by server
                await answer({"type": "websocket.close", "code": INTERNAL_ERROR})
            return
        response = await self.failed(Request(scope, receive), error)
        if observed.status is None:
            await response(scope, receive, answer)

    def _say(self, scope: Scope, observed: Observed) -> None:
        duration_s = time.monotonic() - observed.started_s
        status = observed.status or CLIENT_CLOSED
        method = scope["method"] if scope["type"] == "http" else "WEBSOCKET"
        route = scope["state"].get(ROUTE, OTHER)
        self.instruments.answered(route, method, status, None if observed.is_stream else duration_s)
        caller = getattr(scope["state"].get("caller"), "name", None)
        log.log(
            logging.DEBUG if route in QUIET and status < 400 else logging.INFO,
            "%s %s %d in %.1f ms%s",
            method,
            scope["path"],
            status,
            1000 * duration_s,
            f" for {caller}" if caller else "",
            extra={
                "method": method,
                "path": scope["path"],
                "route": route,
                "status": status,
                "duration_ms": round(1000 * duration_s, 3),
                "caller": caller,
                "client": scope["client"][0] if scope.get("client") else None,
            },
        )


class Routed:
    """The innermost layer: tells the outermost which route was taken; layers between may copy the scope."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await self.app(scope, receive, send)
        finally:
            if "state" in scope:
                scope["state"][ROUTE] = _template(scope)


def _template(scope: Scope) -> str:
    """The path with the names of its parameters; of sockets, whose route is not told, made of the values."""
    if scope["type"] == "http":
        return str(getattr(scope.get("route"), "path", OTHER))
    if "endpoint" not in scope:
        return OTHER
    names = {str(value): name for name, value in scope.get("path_params", {}).items()}
    parts = scope["path"].split("/")
    return "/".join(f"{{{names.pop(part)}}}" if part in names else part for part in parts)
