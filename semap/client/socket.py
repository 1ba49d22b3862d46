"""A WebSocket of the client: what it is opened with, and what its failures say to the plans."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import httpx
from websockets.exceptions import ConnectionClosed, InvalidStatus

from semap.client.streaming import Streaming

PASSED_ON = ("authorization", "user-agent")


def socket_arguments(http: httpx.Client | httpx.AsyncClient, streaming: Streaming) -> dict[str, Any]:
    """For `connect` of websockets: the same service, with the same token, as a client of httpx asks."""
    base = http.base_url
    scheme = {"http": "ws", "https": "wss"}[base.scheme]
    url = base.copy_with(scheme=scheme).join(f"{base.path.rstrip('/')}{streaming.path}")
    return {
        "uri": str(url.copy_merge_params({"source": streaming.source})),
        "additional_headers": {name: http.headers[name] for name in PASSED_ON if name in http.headers},
        "user_agent_header": None,
        "compression": None,
    }


def said_by(error: InvalidStatus) -> tuple[int, Mapping[str, str], bytes]:
    """Status, headers by their names in small letters, and body of what refused a connection."""
    answer = error.response
    headers = {name.lower(): value for name, value in answer.headers.raw_items()}
    return answer.status_code, headers, bytes(answer.body or b"")


def closed_by(error: Exception) -> tuple[str, int | None]:
    """Why a connection is lost, and the code with which the service closed it."""
    code = error.rcvd.code if isinstance(error, ConnectionClosed) and error.rcvd is not None else None
    return str(error) or type(error).__name__, code
