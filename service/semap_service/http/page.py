"""The page: files that are built from service/page, served to browsers.

The names of built files carry the hash of what is in them, so that a browser keeps them for good; the page
itself, which names them, is asked for each time. Every file lies there compressed as well, as `NAME.br` and
`NAME.gz`.
"""

from __future__ import annotations

import os
import re
from http import HTTPStatus
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.responses import FileResponse, HTMLResponse, RedirectResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from semap_service.http.security_headers import DEFAULTS, PAGE_POLICY

FILES = Path(__file__).parents[1] / "page_files"
INDEX = "index.html"
ASSETS = "assets/"
MOUNTED_AT = "/page"

FOR_GOOD = "public, max-age=31536000, immutable"
ASK_EACH_TIME = "no-cache"
CODINGS = (("br", ".br"), ("gzip", ".gz"))
NO_WEIGHT = re.compile(r"q=0(\.0*)?")

SECURITY = {**DEFAULTS, "Content-Security-Policy": PAGE_POLICY}

NOT_BUILT = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>semap</title>
<h1>semap is running, its page is not built</h1>
<p>Everything works over the API: see <a href="/docs">/docs</a>.</p>
<p>In a checkout, <code>./dev page</code> builds the page (it needs Node.js 20.19 or newer).
An installed semap has it.</p>
</html>
"""


def front(request: Request) -> Response:
    """The page, or where it is not built a word on how to build it (503)."""
    if not _is_built():
        return _not_built()
    return _file(FILES / INDEX, request.headers.get("accept-encoding", ""), ASK_EACH_TIME)


def _is_built() -> bool:
    return (FILES / INDEX).is_file()


def _not_built() -> Response:
    return HTMLResponse(NOT_BUILT, HTTPStatus.SERVICE_UNAVAILABLE, SECURITY)


def add_page(app: FastAPI) -> None:
    """Serve the built files at /page/; the page itself is at /."""

    @app.get(MOUNTED_AT + "/", include_in_schema=False)
    def to_front() -> Response:
        return RedirectResponse("/")

    app.mount(MOUNTED_AT, PageFiles(directory=FILES, check_dir=False), name="page")


class PageFiles(StaticFiles):
    """The built files, compressed where the browser takes that; without them, what `front` says then."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if _is_built():
            await super().__call__(scope, receive, send)
        else:
            await _not_built()(scope, receive, send)

    def file_response(
        self,
        full_path: str | os.PathLike[str],
        stat_result: os.stat_result,
        scope: Scope,
        status_code: int = 200,
    ) -> Response:
        path = Path(full_path)
        headers = dict(scope["headers"])
        known = headers.get(b"if-none-match", b"").decode("latin-1")
        is_asset = path.relative_to(FILES.resolve()).as_posix().startswith(ASSETS)
        response = _file(
            path,
            headers.get(b"accept-encoding", b"").decode("latin-1"),
            FOR_GOOD if is_asset else ASK_EACH_TIME,
        )
        if known and known == response.headers.get("etag"):
            kept = {key: response.headers[key] for key in ("etag", "cache-control", "vary")}
            return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=kept)
        return response


def _file(path: Path, accepted: str, caching: str) -> FileResponse:
    """A file in the best coding that is accepted and there, with an ETag of its own for each coding."""
    headers = {**SECURITY, "Cache-Control": caching, "Vary": "Accept-Encoding"}
    served = path
    for coding, suffix in CODINGS:
        packed = path.with_name(path.name + suffix)
        if _accepts(accepted, coding) and packed.is_file():
            served = packed
            headers["Content-Encoding"] = coding
            break
    stat = served.stat()
    headers["ETag"] = f'"{stat.st_mtime_ns:x}-{stat.st_size:x}-{served.suffix[1:]}"'
    return FileResponse(served, headers=headers, media_type=_media_type(path), stat_result=stat)


def _accepts(header: str, coding: str) -> bool:
    """Whether Accept-Encoding (RFC 9110, 12.5.3) names a coding, and not with the weight 0."""
    for part in header.split(","):
        name, _, weight = part.partition(";")
        if name.strip().lower() == coding:
            return not NO_WEIGHT.fullmatch(weight.strip())
    return False


def _media_type(path: Path) -> str:
    # By name and not by the machine's table of types, which some machines have wrong.
    return {
        ".html": "text/html; charset=utf-8",
        ".js": "text/javascript; charset=utf-8",
        ".css": "text/css; charset=utf-8",
        ".svg": "image/svg+xml",
        ".png": "image/png",
        ".json": "application/json",
    }.get(path.suffix, "application/octet-stream")
