"""How the page is served: what a browser is told of each file, whether or not the page was built."""

from __future__ import annotations

import asyncio
import gzip
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from semap_service.http import page

SCRIPT = "assets/index-1a2b3c.js"
Get = Callable[..., httpx.Response]
WHOLE = b"console.log('semap')" * 100


@pytest.fixture
def built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "page_files"
    (folder / "assets").mkdir(parents=True)
    (folder / "index.html").write_text("<!doctype html><title>semap</title>")
    (folder / SCRIPT).write_bytes(WHOLE)
    (folder / f"{SCRIPT}.gz").write_bytes(gzip.compress(WHOLE))
    (folder / "icon.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    monkeypatch.setattr(page, "FILES", folder)
    return folder


@pytest.fixture
def unbuilt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that is not there; asked for before `get`, whose app remembers it."""
    monkeypatch.setattr(page, "FILES", tmp_path / "page_files")
    return page.FILES


@pytest.fixture
def get() -> Get:
    """Asks an app that has the page and nothing else."""
    app = FastAPI()
    page.add_page(app)
    app.get("/")(page.front)

    async def ask(path: str, headers: dict[str, str] | None) -> httpx.Response:
        transport = httpx.ASGITransport(app)
        async with httpx.AsyncClient(transport=transport, base_url="http://semap") as client:
            return await client.get(path, headers=headers)

    return lambda path, headers=None: asyncio.run(ask(path, headers))


@pytest.mark.usefixtures("built")
def test_the_page_is_asked_for_each_time_and_its_files_are_kept_for_good(get: Get) -> None:
    front = get("/")
    assert (front.status_code, front.headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert front.headers["cache-control"] == "no-cache"
    script = get(f"/page/{SCRIPT}")
    assert script.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert script.headers["content-type"] == "text/javascript; charset=utf-8"
    assert get("/page/icon.svg").headers["cache-control"] == "no-cache"
    assert get("/page/").headers["location"] == "/"


@pytest.mark.usefixtures("built")
def test_a_file_is_sent_compressed_to_those_who_take_that(get: Get) -> None:
    packed = get(f"/page/{SCRIPT}", headers={"Accept-Encoding": "br;q=0.5, gzip"})
    assert (packed.headers["content-encoding"], packed.headers["vary"]) == ("gzip", "Accept-Encoding")
    assert packed.content == WHOLE
    assert int(packed.headers["content-length"]) < len(WHOLE) / 5
    for refused in ("identity", "gzip;q=0", "gzip; q=0.000"):
        plain = get(f"/page/{SCRIPT}", headers={"Accept-Encoding": refused})
        assert "content-encoding" not in plain.headers
        assert plain.content == WHOLE
        assert plain.headers["etag"] != packed.headers["etag"]


@pytest.mark.usefixtures("built")
def test_a_browser_that_has_a_file_is_not_sent_it_again(get: Get) -> None:
    first = get("/page/icon.svg")
    again = get("/page/icon.svg", headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert again.headers["cache-control"] == "no-cache"
    assert get("/page/icon.svg", headers={"If-None-Match": '"other"'}).status_code == 200


@pytest.mark.usefixtures("built")
def test_nothing_from_elsewhere_may_run_on_the_page(get: Get) -> None:
    policy = get("/").headers["content-security-policy"]
    directives = dict(each.strip().split(" ", 1) for each in policy.split(";"))
    assert directives["default-src"] == "'self'"
    assert "script-src" not in directives
    assert "style-src" not in directives
    assert directives["frame-ancestors"] == directives["base-uri"] == "'none'"
    assert get("/").headers["x-content-type-options"] == "nosniff"


@pytest.mark.usefixtures("built")
@pytest.mark.parametrize(
    "path", ["/page/../page.py", "/page/%2e%2e/page.py", "/page/assets/..%2f..%2fpage.py", "/page/none.js"]
)
def test_nothing_else_is_sent(get: Get, path: str) -> None:
    assert get(path).status_code == 404


@pytest.mark.parametrize("path", ["/", f"/page/{SCRIPT}", "/page/assets/", "/page/icon.svg", "/page/%00"])
def test_without_the_page_the_service_says_how_to_build_it(unbuilt: Path, get: Get, path: str) -> None:
    for _ in ("no folder", "a folder without a page"):
        said = get(path)
        assert (said.status_code, said.headers["content-type"]) == (503, "text/html; charset=utf-8")
        assert "./dev page" in said.text
        unbuilt.mkdir(exist_ok=True)


def test_a_page_that_is_built_meanwhile_is_served(unbuilt: Path, get: Get) -> None:
    assert get("/page/icon.svg").status_code == 503
    unbuilt.mkdir()
    (unbuilt / "index.html").touch()
    (unbuilt / "icon.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    assert get("/page/icon.svg").status_code == 200
