"""How a request is refused: a problem over HTTP, a message and a close code over a WebSocket."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from http import HTTPStatus

from starlette.types import Receive, Send
from starlette.types import Scope as Connection

from semap_service.access.credentials import SUBPROTOCOL
from semap_service.http.problem import problem_response

CLOSE_CODES = {
    HTTPStatus.UNAUTHORIZED: 4401,
    HTTPStatus.FORBIDDEN: 4403,
    HTTPStatus.TOO_MANY_REQUESTS: 4429,
    HTTPStatus.SERVICE_UNAVAILABLE: 1013,
}
POLICY_VIOLATION = 1008

TOO_LONG = (HTTPStatus.REQUEST_URI_TOO_LONG, HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
"""What is wrong with a request before it is one: an upgrade is answered like any other."""
DENIAL = "websocket.http.response"


@dataclass(frozen=True)
class Refusal:
    """Why a request does not come in, and what can be done about it."""

    status: HTTPStatus
    kind: str
    detail: str
    remedy: str
    headers: Mapping[str, str] = field(default_factory=dict)


async def refuse(refusal: Refusal, connection: Connection, receive: Receive, send: Send) -> None:
    """Answer a request that has not been answered yet."""
    if connection["type"] == "http" or (refusal.status in TOO_LONG and DENIAL in connection["extensions"]):
        response = problem_response(
            connection["path"],
            refusal.status,
            refusal.detail,
            kind=refusal.kind,
            remedy=refusal.remedy,
            headers=dict(refusal.headers),
        )
        await response(connection, receive, send)
        return
    await receive()  # websocket.connect
    offered = connection.get("subprotocols", ())
    await send({"type": "websocket.accept", "subprotocol": SUBPROTOCOL if SUBPROTOCOL in offered else None})
    await close(refusal, send)


async def close(refusal: Refusal, send: Send) -> None:
    """End a WebSocket that is open."""
    code = CLOSE_CODES.get(refusal.status, POLICY_VIOLATION)
    await send({"type": "websocket.send", "text": _message(refusal)})
    await send({"type": "websocket.close", "code": code, "reason": refusal.detail[:120]})


def _message(refusal: Refusal) -> str:
    return json.dumps({"type": "error", "detail": refusal.detail, "remedy": refusal.remedy})
