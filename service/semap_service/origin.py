"""Who may write from a browser: pages that semap serves itself.

There are no passwords yet, so a page of any other site, open in a browser on this machine, could post
to the service or follow its feed. A browser names the page's site in the header Origin; other programs
send none.
"""

from __future__ import annotations

from http import HTTPStatus
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send

from semap_service.problem import problem_response

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
POLICY_VIOLATION = 1008


class OwnOrigin:
    """Refuses writes and feeds that a page of another site asks for."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if (
            scope["type"] not in ("http", "websocket")
            or scope.get("method") in SAFE_METHODS
            or _is_own(scope)
        ):
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": POLICY_VIOLATION})
        else:
            detail = "A page of another site may not write here."
            await problem_response(scope["path"], HTTPStatus.FORBIDDEN, detail)(scope, receive, send)


def _is_own(scope: Scope) -> bool:
    headers = dict(scope["headers"])
    origin = headers.get(b"origin")
    return origin is None or urlsplit(origin.decode("latin-1")).netloc == headers.get(b"host", b"").decode(
        "latin-1"
    )
