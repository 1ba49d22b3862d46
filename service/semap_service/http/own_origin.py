"""Who may write from a browser: pages that semap serves itself, and those of sites that are allowed.

A page of any other site, open in a browser that reaches the service, could post to it or follow its feed;
without tokens nothing else stops it. A browser names the page's site in the header Origin; other programs
send none.
"""

from __future__ import annotations

from collections.abc import Sequence
from http import HTTPStatus
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send

from semap.errors import InvalidInput
from semap_service.http.problem import problem_response

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
POLICY_VIOLATION = 1008


class OwnOrigin:
    """Refuses writes and feeds that a page of another site asks for, unless the site is allowed."""

    def __init__(self, app: ASGIApp, allowed: Sequence[str] = ()) -> None:
        self.app = app
        self.allowed = frozenset(allowed)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if (
            scope["type"] not in ("http", "websocket")
            or scope.get("method") in SAFE_METHODS
            or self._is_own(scope)
        ):
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})
        else:
            await problem_response(
                scope["path"],
                HTTPStatus.FORBIDDEN,
                "A page of another site may not write here.",
                kind="foreign-page",
                remedy="Start the service with --allow-origin and the site of the page.",
            )(scope, receive, send)

    def _is_own(self, scope: Scope) -> bool:
        headers = dict(scope["headers"])
        origin = headers.get(b"origin")
        if origin is None or origin.decode("latin-1") in self.allowed:
            return True
        host: str = headers.get(b"host", b"").decode("latin-1")
        return host != "" and origin.decode("latin-1").partition("://")[2] == host


def require_origin(text: str) -> str:
    """An origin as browsers send it: scheme, host, and a port where it is not the usual one.

    raises  InvalidInput
    """
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError:
        parts, port = urlsplit(""), None
    host = f"[{parts.hostname}]" if parts.hostname and ":" in parts.hostname else parts.hostname
    usual = {"http": 80, "https": 443}.get(parts.scheme)
    if (
        usual is None
        or not host
        or parts.username
        or parts.path not in ("", "/")
        or parts.query
        or parts.fragment
    ):
        raise InvalidInput(
            f"{text} is no origin", "Give scheme and host, such as https://maps.example.", "--allow-origin"
        )
    return f"{parts.scheme}://{host}" + ("" if port in (None, usual) else f":{port}")
