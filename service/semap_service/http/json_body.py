"""Bodies of JSON: bounded in bytes and in values, and what is large is answered beside the event loop.

A document of a megabyte may have half a million values. To read it is one call into C, during which nobody
else is answered, in whatever thread it is made; so there is an end to how many there may be. To validate it,
and to say what is wrong with it, is a matter for a thread with a loop of its own.
"""

from __future__ import annotations

import asyncio
import re
from functools import partial
from http import HTTPStatus

import anyio
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from semap.errors import InvalidInput, TooLarge
from semap_service.documents.json_values import require_few_values
from semap_service.http.problem import problem_response

MOST_BYTES = 1024**2
BESIDE_BYTES = 16 * 1024
"""From so many on the loop should not wait for it."""
AT_ONCE = 4

UPLOADS = re.compile(
    r"/maps/import|/maps/[^/]+/instances(/import)?|/instances/\d+/mesh|/maps/[^/]+/grids/[^/]+"
    r"|/descriptions/\d+/geometries/[^/]+/mesh"
)
"""What takes files, as multipart/form-data; everything else takes JSON."""

WITH_BODY = ("POST", "PUT", "PATCH", "DELETE")


class BoundedJson:
    """ASGI middleware; around it the bytes of a body are limited already."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._turns: anyio.CapacityLimiter | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] not in WITH_BODY or is_upload(scope):
            await self.app(scope, receive, send)
            return
        try:
            body = await _whole(receive)
        except HTTPException as error:
            refusal = problem_response(scope["path"], HTTPStatus(error.status_code), error.detail)
            await refusal(scope, receive, send)
            return
        if body is None:
            return
        if len(body) < BESIDE_BYTES:
            await self.app(scope, _again(body, receive), send)
            return
        self._turns = self._turns or anyio.CapacityLimiter(AT_ONCE)
        answer = partial(asyncio.run, self._answer(scope, body))
        for message in await anyio.to_thread.run_sync(answer, limiter=self._turns):
            await send(message)

    async def _answer(self, scope: Scope, body: bytes) -> list[Message]:
        """In a loop of its own: the whole answer."""
        messages: list[Message] = []

        async def keep(message: Message) -> None:
            messages.append(message)

        receive = _again(body, _never)
        try:
            require_few_values(body)
        except (InvalidInput, TooLarge) as error:
            too_large = isinstance(error, TooLarge)
            status = HTTPStatus.REQUEST_ENTITY_TOO_LARGE if too_large else HTTPStatus.UNPROCESSABLE_ENTITY
            kind = "too-large" if too_large else "invalid-input"
            refusal = problem_response(scope["path"], status, str(error), kind=kind, remedy=error.remedy)
            await refusal(scope, receive, keep)
        else:
            await self.app(scope, receive, keep)
        return messages


def is_upload(scope: Scope) -> bool:
    """Whether a request may bring files."""
    return scope["method"] in ("POST", "PUT") and UPLOADS.fullmatch(scope["path"]) is not None


async def _whole(receive: Receive) -> bytes | None:
    """A body; None where its sender has gone."""
    parts: list[bytes] = []
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            return None
        parts.append(message.get("body", b""))
        if not message.get("more_body", False):
            return b"".join(parts)


def _again(body: bytes, then: Receive) -> Receive:
    """Gives the body as one message, and then what comes after it."""
    messages = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> Message:
        return messages.pop() if messages else await then()

    return receive


async def _never() -> Message:
    """The sender is taken to be there until it is answered."""
    await asyncio.Event().wait()
    raise AssertionError
