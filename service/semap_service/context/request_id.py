"""The id of a request: in every line that is logged for it, in every problem, and in the header X-Request-ID.

A caller's own id is kept where it is well-formed, so that one id leads through all services; else the trace
of a W3C `traceparent` (Trace Context, section 3.2) is the id, else one is made.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextvars import ContextVar
from uuid import uuid4

HEADER = "X-Request-ID"
IDENTITY = "semap.request_id"
"""Where a layer further out puts the id into the scope of ASGI."""

WELL_FORMED = re.compile(rb"[A-Za-z0-9][A-Za-z0-9._:-]{0,127}")
TRACEPARENT = re.compile(
    rb"(?!ff)[0-9a-f]{2}-(?!0{32})([0-9a-f]{32})-(?!0{16})[0-9a-f]{16}-[0-9a-f]{2}(-.*)?"
)

CURRENT: ContextVar[str] = ContextVar("semap_request_id", default="")


def current_request_id() -> str:
    """The id of the request that is answered here; empty outside of one."""
    return CURRENT.get()


def request_id(headers: Mapping[bytes, bytes]) -> str:
    """The id that a request brings, or a new one; names of headers are in lower case."""
    own = headers.get(b"x-request-id", b"")
    if WELL_FORMED.fullmatch(own):
        return own.decode("ascii")
    parent = TRACEPARENT.fullmatch(headers.get(b"traceparent", b""))
    return parent[1].decode("ascii") if parent else uuid4().hex
