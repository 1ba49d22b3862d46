"""How large the body of a request may be: small where it is no file, larger where it becomes a job."""

from __future__ import annotations

import re

from starlette.types import Scope

from semap_service.http.body_limit import LIMIT_BYTES
from semap_service.http.json_body import MOST_BYTES, is_upload

TO_JOBS = re.compile(
    r"/maps/import|/maps/[^/]+/instances/import|/instances/\d+/mesh|/descriptions/\d+/geometries/[^/]+/mesh"
)
WANTED = re.compile(rb"(^|[,\s])respond-async($|[,;\s])")


def wants_job(prefer: bytes) -> bool:
    """Whether a header Prefer asks for an answer before the work is done (RFC 7240, 4.1)."""
    return WANTED.search(prefer.lower()) is not None


def body_limit(scope: Scope, job_bytes: int) -> int:
    """The limit for a request [bytes]."""
    if not is_upload(scope):
        return MOST_BYTES
    if TO_JOBS.fullmatch(scope["path"]) is None:
        return LIMIT_BYTES
    prefer = b",".join(value for name, value in scope["headers"] if name == b"prefer")
    return max(job_bytes, LIMIT_BYTES) if wants_job(prefer) else LIMIT_BYTES
