"""Requests as httpx sends them, and its answers and failures as the plans are told of them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import httpx

from semap.client.exchange import Answer, Lost, Request
from semap.client.following import SILENCE_S
from semap.errors import InvalidInput
from semap.version import VERSION

DEFAULT_URL = "http://127.0.0.1:8000"
URL_VARIABLE = "SEMAP_URL"
TOKEN_VARIABLE = "SEMAP_TOKEN"  # noqa: S105  (its name, not a token)


def settings(url: str | None, token: str | None, timeout_s: float) -> dict[str, Any]:
    """What both kinds of httpx's clients are made with.

    raises  InvalidInput for an address that is none
    """
    address = url or os.environ.get(URL_VARIABLE) or DEFAULT_URL
    try:
        base = httpx.URL(address)
    except httpx.InvalidURL as error:
        raise InvalidInput(f"{address!r} is no address", "Give one such as http://127.0.0.1:8000.") from error
    if base.scheme not in ("http", "https") or not base.host:
        raise InvalidInput(
            f"{address!r} is no address of a service", "Give one such as http://127.0.0.1:8000."
        )
    secret = token if token is not None else os.environ.get(TOKEN_VARIABLE)
    headers = {"User-Agent": f"semap/{VERSION}"}
    if secret:
        if not (secret.isascii() and secret.isprintable()):
            raise InvalidInput(
                "the token has letters that no token has", "Give it as `semap token add` prints it."
            )
        headers["Authorization"] = f"Bearer {secret}"
    return {"base_url": base, "headers": headers, "timeout": timeout_s}


@contextmanager
def arguments(request: Request) -> Iterator[dict[str, Any]]:
    """What httpx is called with; files are open meanwhile.

    raises  InvalidInput for a file that cannot be read
    """
    with ExitStack() as opened:
        files: dict[str, Any] = {}
        for field, upload in request.files.items():
            content: Any = upload.content
            if isinstance(content, Path):
                try:
                    content = opened.enter_context(content.open("rb"))
                except OSError as error:
                    raise InvalidInput(
                        f"{content} cannot be read: {error.strerror}", "Check the path."
                    ) from error
            files[field] = (upload.name, content)
        # a form without a file is sent as one, too
        form = {name: (None, value) for name, value in request.form.items()}
        yield {
            "method": request.method,
            "url": request.path,
            "params": dict(request.query),
            "headers": dict(request.headers),
            **({} if request.body is None else {"json": request.body}),
            **({"files": {**form, **files}} if form or files else {}),
        }


def stream_arguments(request: Request) -> dict[str, Any]:
    """The same for a stream, which may be silent for a while."""
    return {
        "method": request.method,
        "url": request.path,
        "params": dict(request.query),
        "headers": dict(request.headers),
        "timeout": httpx.Timeout(SILENCE_S),
    }


def answer_of(response: httpx.Response) -> Answer:
    """headers  by their names in small letters"""
    return Answer(response.status_code, dict(response.headers), response.content)


def lost(error: httpx.RequestError) -> Lost:
    """What a plan is told where no whole answer came."""
    unsent = isinstance(error, httpx.ConnectError | httpx.ConnectTimeout | httpx.PoolTimeout)
    return Lost(str(error) or type(error).__name__, unsent)
