"""Answers in gzip, for those who take it.

Only whole documents of text are compressed: a stream would wait for what is to come, and meshes and archives
are compressed already. A compressed answer is another representation with an ETag of its own (RFC 9110,
8.8.3.3): that of the plain one with a suffix, which is taken off again where a request names it.
"""

from __future__ import annotations

import gzip
import re

import anyio.to_thread
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SMALLEST = 1_000
"""Bytes that are worth it."""

IN_THREAD = 64_000
"""Bytes from which on the event loop should not wait for it."""

LEVEL = 5
TEXT = re.compile(r"text/(?!event-stream)|application/(.*\+)?(json|xml|yaml)\b|model/gltf\+json")
TAKEN = re.compile(r"(?:^|,)\s*(?:gzip|\*)\s*(?!;\s*q=0(?:\.0*)?\s*(?:,|$))(?:;|,|$)", re.IGNORECASE)
SUFFIX = "-gzip"
CONDITIONS = (b"if-match", b"if-none-match")


class Compressed:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        answer = _Answer(send, takes_gzip(Headers(scope=scope).get("accept-encoding", "")))
        suffix = SUFFIX.encode() + b'"'
        if any(name in CONDITIONS and suffix in value for name, value in scope["headers"]):
            answer.names_compressed = True
            scope["headers"] = [
                (name, value.replace(suffix, b'"') if name in CONDITIONS else value)
                for name, value in scope["headers"]
            ]
        await self.app(scope, receive, answer.send)


class _Answer:
    """One answer on its way: its head waits for the first part of its body."""

    def __init__(self, send: Send, takes: bool) -> None:
        self._send = send
        self._takes = takes
        self._head: Message | None = None
        self.names_compressed = False

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self._head = message
            return
        if self._head is not None:
            head, self._head = self._head, None
            if message["type"] == "http.response.body" and not message.get("more_body", False):
                message = await self._whole(head, message)
            await self._send(head)
        await self._send(message)

    async def _whole(self, head: Message, message: Message) -> Message:
        headers = MutableHeaders(raw=head.setdefault("headers", []))
        body: bytes = message.get("body", b"")
        if head["status"] == 304 and self.names_compressed:
            _suffix_etag(headers)
        if not TEXT.match(headers.get("content-type", "")) or "content-encoding" in headers:
            return message
        headers.add_vary_header("Accept-Encoding")
        if not self._takes or len(body) < SMALLEST or "content-range" in headers:
            return message
        if len(body) < IN_THREAD:
            packed = gzip.compress(body, LEVEL, mtime=0)
        else:
            packed = await anyio.to_thread.run_sync(lambda: gzip.compress(body, LEVEL, mtime=0))
        headers["Content-Encoding"] = "gzip"
        headers["Content-Length"] = str(len(packed))
        _suffix_etag(headers)
        return {**message, "body": packed}


def takes_gzip(accept_encoding: str) -> bool:
    """Whether Accept-Encoding asks for gzip, which `q=0` refuses (RFC 9110, 12.5.3)."""
    return TAKEN.search(accept_encoding) is not None


def _suffix_etag(headers: MutableHeaders) -> None:
    etag = headers.get("etag", "")
    if etag.endswith('"'):
        headers["ETag"] = f'{etag[:-1]}{SUFFIX}"'
