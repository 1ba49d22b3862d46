"""Problem documents (RFC 9457) as the errors of semap that they stand for."""

from __future__ import annotations

import json
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from semap.errors import (
    AccessRefused,
    ChangedMeanwhile,
    Conflict,
    InvalidInput,
    NotFound,
    SemapError,
    ServerUnavailable,
    TooLarge,
    TooManyRequests,
)

ERRORS: Mapping[int, type[SemapError]] = {
    HTTPStatus.BAD_REQUEST: InvalidInput,
    HTTPStatus.UNAUTHORIZED: AccessRefused,
    HTTPStatus.FORBIDDEN: AccessRefused,
    HTTPStatus.CONFLICT: Conflict,
    HTTPStatus.PRECONDITION_FAILED: ChangedMeanwhile,
    HTTPStatus.REQUEST_ENTITY_TOO_LARGE: TooLarge,
    HTTPStatus.UNPROCESSABLE_ENTITY: InvalidInput,
    HTTPStatus.SERVICE_UNAVAILABLE: ServerUnavailable,
}
"""By status; 404 and 429 know more, and all others are a SemapError."""

LONGEST_WAIT_S = 60.0


def error_of(status: int, headers: Mapping[str, str], content: bytes) -> SemapError:
    """The error that an answer stands for, whoever sent it: a proxy's page has no problem document."""
    try:
        document = json.loads(content)
    except ValueError:
        document = None
    return error_of_document(status, headers, document if isinstance(document, dict) else {})


def error_of_document(status: int, headers: Mapping[str, str], document: Mapping[str, Any]) -> SemapError:
    """The error of a problem document."""
    message = str(document.get("detail") or f"The service answers with status {status}.")
    remedy = str(document.get("remedy") or "")
    if status in (HTTPStatus.NOT_FOUND, HTTPStatus.GONE):
        return NotFound.said(message, remedy)
    if status == HTTPStatus.TOO_MANY_REQUESTS:
        return TooManyRequests(message, remedy, retry_after_s(headers))
    kind = ERRORS.get(status)
    if kind is InvalidInput:
        return InvalidInput(message, remedy)
    return SemapError(message, remedy) if kind is None else kind(message, remedy)


def retry_after_s(headers: Mapping[str, str]) -> float:
    """The seconds of Retry-After (RFC 9110, 10.2.3), 1 where it says none; its form as a date is not read."""
    said = headers.get("retry-after", "").strip()
    return min(float(said), LONGEST_WAIT_S) if said.isascii() and said.isdigit() else 1.0
