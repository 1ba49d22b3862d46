"""The limit of what may be uploaded, kept while the body arrives."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from http import HTTPStatus

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from semap_service.http.problem import problem_response

LIMIT_BYTES = 64 * 1024**2
STALL_S = 30.0
LEAST_BYTES_PER_S = 1000


class LimitedBody:
    """Refuses a body above the limit: at once where its length is announced, else as soon as it exceeds.

    A body that stops arriving is given up, so that clients who never finish do not hold what they began.

    limit_of  how many bytes a request may have
    stall_s   how long the next part of a body is waited for, and how much longer than LEAST_BYTES_PER_S asks
              for the parts together
    """

    def __init__(
        self,
        app: ASGIApp,
        limit_of: Callable[[Scope], int] = lambda _: LIMIT_BYTES,
        stall_s: float = STALL_S,
    ) -> None:
        self.app = app
        self.limit_of = limit_of
        self.stall_s = stall_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        limit_bytes = self.limit_of(scope)
        detail = f"The body is larger than {limit_bytes} bytes."
        announced = dict(scope["headers"]).get(b"content-length", b"0")
        if announced.isdigit() and int(announced) > limit_bytes:
            response = problem_response(
                scope["path"], HTTPStatus.REQUEST_ENTITY_TOO_LARGE, detail, kind="too-large"
            )
            await response(scope, receive, send)
            return
        received = 0
        waited_s = 0.0
        has_all = False

        async def limited() -> Message:
            nonlocal received, waited_s, has_all
            if has_all:
                return await receive()  # that the client goes away is waited for without end
            left_s = self.stall_s + received / LEAST_BYTES_PER_S - waited_s
            began_s = time.monotonic()
            try:
                message = await asyncio.wait_for(receive(), min(self.stall_s, left_s))
            except TimeoutError:
                raise HTTPException(
                    HTTPStatus.REQUEST_TIMEOUT, f"The body did not go on arriving within {self.stall_s:g} s."
                ) from None
            waited_s += time.monotonic() - began_s
            received += len(message.get("body", b""))
            has_all = not message.get("more_body", False)
            if received > limit_bytes:
                raise HTTPException(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, detail)
            return message

        await self.app(scope, limited, send)
