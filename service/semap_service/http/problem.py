"""Errors as documents: RFC 9457, application/problem+json.

Every error of semap is translated here and nowhere else. `remedy` is what the reader can do about it.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Iterable
from http import HTTPStatus
from typing import Any, TypeAlias

from fastapi import APIRouter, FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from starlette.exceptions import HTTPException

from semap.errors import (
    AccessRefused,
    ChangedMeanwhile,
    Conflict,
    DatabaseError,
    InvalidInput,
    NotFound,
    SemapError,
    ServerUnavailable,
    StatementTooLong,
    TooLarge,
    TooManyRequests,
)
from semap_service.documents.document import MANY_UNKNOWN
from semap_service.documents.problem import MOST_PLACES, Place, Problem

log = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"
TYPE = "urn:semap:problem:"
RETRY_S = "1"

LONGEST_PART = 100
LONGEST_TEXT = 2000
UNKNOWN = "Extra inputs are not permitted"

Methods: TypeAlias = tuple[tuple[re.Pattern[str], frozenset[str]], ...]

STATUS: tuple[tuple[type[SemapError], HTTPStatus, str], ...] = (
    (NotFound, HTTPStatus.NOT_FOUND, "not-found"),
    (Conflict, HTTPStatus.CONFLICT, "conflict"),
    (AccessRefused, HTTPStatus.FORBIDDEN, "forbidden"),
    (ChangedMeanwhile, HTTPStatus.PRECONDITION_FAILED, "changed-meanwhile"),
    (TooLarge, HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too-large"),
    (InvalidInput, HTTPStatus.UNPROCESSABLE_ENTITY, "invalid-input"),
    (TooManyRequests, HTTPStatus.TOO_MANY_REQUESTS, "too-many-requests"),
    (ServerUnavailable, HTTPStatus.SERVICE_UNAVAILABLE, "database-unavailable"),
    (StatementTooLong, HTTPStatus.GATEWAY_TIMEOUT, "too-long"),
    (DatabaseError, HTTPStatus.INTERNAL_SERVER_ERROR, "database"),
    (SemapError, HTTPStatus.INTERNAL_SERVER_ERROR, "internal"),
)
"""The first class that fits decides."""

REMEDIES = {
    HTTPStatus.NOT_FOUND: "See / for what there is.",
    HTTPStatus.METHOD_NOT_ALLOWED: "Use one of the methods in the header Allow.",
    HTTPStatus.REQUEST_ENTITY_TOO_LARGE: "Split it, simplify the mesh, or upload it as a job (Prefer).",
    HTTPStatus.BAD_REQUEST: "See that the body is complete and of the stated content type.",
}

MEANING = {
    HTTPStatus.NOT_FOUND: "The named resource does not exist.",
    HTTPStatus.CONFLICT: "The request conflicts with the current state.",
    HTTPStatus.PRECONDITION_FAILED: "It is no longer what If-Match names: read it again.",
    HTTPStatus.REQUEST_ENTITY_TOO_LARGE: "The body is larger than the service takes.",
    HTTPStatus.UNPROCESSABLE_ENTITY: "A value that semap cannot use; `errors` names the places.",
    HTTPStatus.BAD_REQUEST: "The body cannot be read.",
    HTTPStatus.INTERNAL_SERVER_ERROR: "Something went wrong inside semap.",
    HTTPStatus.SERVICE_UNAVAILABLE: "The database does not answer; try again later.",
    HTTPStatus.UNAUTHORIZED: "A token is needed, and this is none that is known.",
    HTTPStatus.FORBIDDEN: "The token does not allow this.",
    HTTPStatus.REQUEST_TIMEOUT: "The body did not go on arriving.",
    HTTPStatus.REQUEST_URI_TOO_LONG: "The URL is longer than the service takes.",
    HTTPStatus.MISDIRECTED_REQUEST: "A service without tokens was called by a name of another machine.",
    HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE: "The headers are larger than the service takes.",
    HTTPStatus.GATEWAY_TIMEOUT: "It takes the database too long; request less.",
    HTTPStatus.TOO_MANY_REQUESTS: "Too many requests or open connections; wait as long as Retry-After says.",
}


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses` of an endpoint that may answer with these problems, beside 422, 500 and 503."""
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    return {
        status: {"description": MEANING[HTTPStatus(status)], "content": content}
        for status in sorted({*statuses, 422, 500, 503})
    }


def answer_problems(app: FastAPI) -> None:
    """Let the app answer every error with a problem."""
    app.add_exception_handler(SemapError, _semap_error)
    app.add_exception_handler(RequestValidationError, _validation_error)
    app.add_exception_handler(HTTPException, _http_error)
    for beyond in (RecursionError, OverflowError, UnicodeEncodeError):
        app.add_exception_handler(beyond, _beyond)


def problem_response(
    path: str,
    status: HTTPStatus,
    detail: str,
    *,
    kind: str | None = None,
    remedy: str = "",
    errors: list[Place] | None = None,
    more_errors: int = 0,
    headers: dict[str, str] | None = None,
) -> JSONResponse:
    """A response with a problem; without `kind` the status says it all."""
    problem = Problem(
        type="about:blank" if kind is None else TYPE + kind,
        title=status.phrase,
        status=status,
        detail=_short(detail),
        instance=path,
        remedy=_short(remedy or REMEDIES.get(status, "")),
        errors=(errors or [])[:MOST_PLACES],
        more_errors=max(len(errors or ()) - MOST_PLACES, 0) + more_errors,
    )
    content = problem.model_dump(exclude=None if problem.more_errors else {"more_errors"})
    return JSONResponse(content, status, headers, MEDIA_TYPE)


def places(error: RequestValidationError) -> tuple[list[Place], int]:
    """The first places that a validation names, and how many more there are."""
    found: list[Place] = []
    count = 0
    for each in error.errors():
        if each["type"] == MANY_UNKNOWN:
            count += each["ctx"]["count"]
            found += [_place((*each["loc"], name), UNKNOWN) for name in each["ctx"]["names"]]
        else:
            count += 1
            if len(found) < MOST_PLACES:
                found.append(_place(each["loc"], str(each["msg"])))
    return found[:MOST_PLACES], max(count - MOST_PLACES, 0)


def _place(parts: Iterable[object], message: str) -> Place:
    return Place(where=".".join(str(part)[:LONGEST_PART] for part in parts), message=_short(message))


def _short(text: str) -> str:
    """What was sent may be long, and is in the messages about it."""
    return text if len(text) <= LONGEST_TEXT else f"{text[:LONGEST_TEXT]} ..."


async def _beyond(request: Request, error: BaseException) -> JSONResponse:
    """A request nested too deeply, with a number too large, or with text that is none."""
    log.warning("%s %s: %r", request.method, request.url.path, error)
    return problem_response(
        request.url.path,
        HTTPStatus.UNPROCESSABLE_ENTITY,
        f"The request cannot be read: {type(error).__name__}.",
        kind="invalid-input",
        remedy="Give numbers, texts and nesting of a usual size.",
    )


async def _semap_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, SemapError)  # noqa: S101  (registered for it)
    status, kind = next((status, kind) for class_, status, kind in STATUS if isinstance(error, class_))
    if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
        log.warning("%s %s: %s", request.method, request.url.path, error)
    where = error.where if isinstance(error, InvalidInput) else ""
    return problem_response(
        request.url.path,
        status,
        str(error),
        kind=kind,
        remedy=error.remedy,
        errors=[Place(where=where, message=str(error))] if where else [],
        headers=_retry_after(error, status),
    )


def _retry_after(error: SemapError, status: HTTPStatus) -> dict[str, str] | None:
    if isinstance(error, TooManyRequests):
        return {"Retry-After": str(math.ceil(error.retry_after_s))}
    return {"Retry-After": RETRY_S} if status == HTTPStatus.SERVICE_UNAVAILABLE else None


async def _validation_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)  # noqa: S101  (registered for it)
    wrong, more = places(error)
    return problem_response(
        request.url.path,
        HTTPStatus.UNPROCESSABLE_ENTITY,
        "; ".join(f"{each.where}: {each.message}" for each in wrong[:3]),
        kind="invalid-input",
        remedy="Correct what `errors` lists; /openapi.json has the schema.",
        errors=wrong,
        more_errors=more,
    )


async def _http_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)  # noqa: S101  (registered for it)
    status = HTTPStatus(error.status_code)
    if status == HTTPStatus.BAD_REQUEST and error.__cause__ is not None and _is_json(request):
        return await _beyond(request, error.__cause__)  # JSON, but too deep, or with a number too long
    headers = dict(error.headers or {})
    if status == HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(_methods(request)) or headers.get("Allow", "GET")
    detail = error.detail
    if status == HTTPStatus.NOT_FOUND:
        detail = f"There is nothing at {request.url.path}."
    elif status == HTTPStatus.METHOD_NOT_ALLOWED:
        detail = f"{request.url.path} does not take {request.method}."
    return problem_response(request.url.path, status, detail, headers=headers)


async def unexpected(request: Request, error: Exception) -> JSONResponse:
    """What is answered where nothing else translates an error."""
    log.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return problem_response(
        request.url.path,
        HTTPStatus.INTERNAL_SERVER_ERROR,
        "Something went wrong inside semap.",
        kind="internal",
        remedy="The log of the service has the error; please report it.",
    )


def _is_json(request: Request) -> bool:
    return request.headers.get("Content-Type", "").partition(";")[0].strip().endswith("json")


def published_methods(routers: Iterable[APIRouter]) -> Methods:
    """What can be asked of which paths, for those who ask for something else."""
    routes = [each for router in routers for each in router.routes if isinstance(each, APIRoute)]
    return tuple(
        (each.path_regex, frozenset(each.methods or ())) for each in routes if each.include_in_schema
    )


def _methods(request: Request) -> list[str]:
    """The published methods of a path; the router knows only those of the first route that fits."""
    known: Methods = getattr(request.app.state, "methods", ())
    return sorted({name for path, names in known if path.match(request.url.path) for name in names})
