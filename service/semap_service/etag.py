"""Optimistic concurrency (RFC 9110, 8.8.3 and 13): nobody overwrites what they have not seen.

The ETag of a representation is the hash of its bytes as they are sent, so two answers with the same one are
the same answer. A `TaggedRoute` puts it on what it sends and answers 304 to a reader that has it already; an
`Edit` (semap_service.transaction) compares If-Match with what is there, in the transaction that changes it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Coroutine
from http import HTTPStatus
from typing import Any, TypeAlias

from fastapi import Request, Response
from fastapi.responses import JSONResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel

from semap_service.problem import problems

Representation: TypeAlias = BaseModel | bytes

TAGGED_METHODS = ("GET", "PATCH")
"""The others answer with nothing, or with something else than the resource that was named."""

TAG = re.compile(r'(W/)?("[^"]*")')


class TaggedRoute(APIRoute):
    """A route whose answers carry a strong ETag."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        # An explicit class, so that every version of FastAPI renders the bytes that `etag_of` hashes.
        if options.get("response_class") is None or not isinstance(options["response_class"], type):
            options["response_class"] = JSONResponse
        super().__init__(*arguments, **options)

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
        representation = bytes(JSONResponse(representation.model_dump(mode="json")).body)
    return f'"{hashlib.blake2b(representation, digest_size=16).hexdigest()}"'


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
