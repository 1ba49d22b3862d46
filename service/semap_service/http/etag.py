"""Optimistic concurrency (RFC 9110, 8.8.3 and 13): nobody overwrites what they have not seen.

The ETag of a representation is the hash of its bytes as they are sent, so two answers with the same one are
the same answer. A `TaggedRoute` puts it on what it sends and answers 304 to a reader that has it already; an
`Edit` (database.transaction) compares If-Match with what is there, in the transaction that changes it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Coroutine, Mapping
from functools import wraps
from http import HTTPStatus
from inspect import iscoroutinefunction
from typing import Any, TypeAlias

from fastapi import Request, Response
from fastapi.routing import APIRoute
from pydantic import BaseModel

from semap_service.http.problem import problems

Representation: TypeAlias = BaseModel | bytes

TAGGED_METHODS = ("GET", "PATCH")
"""The others answer with nothing, or with something else than the resource that was named."""

TAG = re.compile(r'(W/)?("[^"]*")')


class TaggedRoute(APIRoute):
    """A route whose answers carry a strong ETag, and are written in the thread that makes them."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        super().__init__(path, _writing(endpoint, options), **options)

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        answer = super().get_route_handler()

        async def tagged(request: Request) -> Response:
            response = await answer(request)
            body = getattr(response, "body", None)
            if request.method not in TAGGED_METHODS or response.status_code != HTTPStatus.OK or body is None:
                return response
            etag = etag_of(bytes(body))
            response.headers["ETag"] = etag
            known = request.headers.get("if-none-match")
            if request.method == "GET" and known is not None and names(known, etag, weakly=True):
                kept = {name: response.headers[name] for name in ("etag", "vary") if name in response.headers}
                return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=kept)
            return response

        return tagged


def etag_of(representation: Representation) -> str:
    """The strong ETag of a document, or of bytes that are sent as they are."""
    if isinstance(representation, BaseModel):
        representation = written(representation)
    return f'"{hashlib.blake2b(representation, digest_size=16).hexdigest()}"'


def written(document: BaseModel, *, is_brief: bool = False) -> bytes:
    """A document as it is sent."""
    return document.model_dump_json(by_alias=True, exclude_none=is_brief).encode()


def _writing(endpoint: Callable[..., Any], options: Mapping[str, Any]) -> Callable[..., Any]:
    """An endpoint that gives the bytes of its document, with the headers that were set beside it.

    options  of its route: the status, the media type, and whether members that are null are left out
    """
    status = options.get("status_code") or HTTPStatus.OK
    media_type = getattr(options.get("response_class"), "media_type", None) or "application/json"
    is_brief = bool(options.get("response_model_exclude_none"))

    if iscoroutinefunction(endpoint):
        return endpoint

    @wraps(endpoint)
    def answer(**values: Any) -> Any:
        given = endpoint(**values)
        if not isinstance(given, BaseModel):
            return given
        response = Response(written(given, is_brief=is_brief), status, media_type=media_type)
        for beside in values.values():
            if isinstance(beside, Response):
                response.headers.raw.extend(beside.headers.raw)
        return response

    return answer


def names(header: str, etag: str, *, weakly: bool = False) -> bool:
    """Whether If-Match names an ETag, or (weakly) If-None-Match does; `*` names every one."""
    if header.strip() == "*":
        return True
    return any(tag == etag and (weakly or not is_weak) for is_weak, tag in TAG.findall(header))


def reads(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses` of a tagged endpoint that reads, beside these problems."""
    unchanged = {"description": "It is still what If-None-Match names."}
    return {**problems(*statuses), int(HTTPStatus.NOT_MODIFIED): unchanged}


def edits(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """The `responses` of an endpoint that heeds If-Match, beside these problems."""
    return problems(HTTPStatus.PRECONDITION_FAILED, *statuses)
