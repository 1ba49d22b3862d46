"""A service that is a function: what the client asks is kept, and answered from a script."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import httpx

from semap import Client

Reply = httpx.Response | Exception


@dataclass
class Script:
    """Answers one after another; the last one again and again."""

    replies: Sequence[Reply]
    asked: list[httpx.Request] = field(default_factory=list)

    def __call__(self, request: httpx.Request) -> httpx.Response:
        request.read()
        reply = self.replies[min(len(self.asked), len(self.replies) - 1)]
        self.asked.append(request)
        if isinstance(reply, Exception):
            raise reply
        return httpx.Response(reply.status_code, headers=reply.headers, content=reply.content)


def client_of(answer: Callable[[httpx.Request], httpx.Response], **options: object) -> Client:
    return Client("http://semap.test", transport=httpx.MockTransport(answer), **options)  # type: ignore[arg-type]


def problem(status: int, detail: str = "no", remedy: str = "do this", **headers: str) -> httpx.Response:
    body = json.dumps({"status": status, "detail": detail, "remedy": remedy})
    return httpx.Response(
        status, headers={name.replace("_", "-"): value for name, value in headers.items()}, content=body
    )
