from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from measured import CHROMIUM, DESKTOP, LARGEST_TOUCHED_PX, PATIENCE_MS, SOFTWARE_GL, flaws, take_picture
from plan import Plan
from playwright.sync_api import (
    Browser,
    BrowserContext,
    ConsoleMessage,
    Page,
    Request,
    expect,
    sync_playwright,
)
from semap_service.http.page import FILES
from served import Office, Served
from server import database_with_slot

from semap.cluster import Cluster


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--screenshots", metavar="DIR", help="write pictures of the page's states there")
    parser.addoption("--renew-pictures", action="store_true", help="keep what the page looks like now")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    missing = None
    if CHROMIUM is None:
        missing = "there is no Chromium: apt-get install chromium"
    elif not (FILES / "index.html").is_file():
        missing = "there is no built page: ./dev page, with Node.js 20.19 or newer"
    if missing is not None:
        for item in items:
            if Path(__file__).parent in item.path.parents:
                item.add_marker(pytest.mark.skip(reason=missing))


@pytest.fixture(scope="session")
def page_database(cluster: Cluster, template: str) -> Iterator[str]:
    with database_with_slot(cluster, template) as dsn:
        yield dsn


@pytest.fixture(scope="session")
def served(page_database: str) -> Iterator[Served]:
    """One service for all tests that leave it alone; each has a map of its own on it."""
    running = Served(page_database)
    try:
        yield running.start()
    finally:
        running.stop()


# Not for the whole run: while it is open, asyncio has a running loop, which other tests must not meet.
@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as driver:
        running = driver.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE_GL)
        yield running
        running.close()


@pytest.fixture
def office(served: Served, request: pytest.FixtureRequest) -> Iterator[Office]:
    """The demo's office as a map that is named as the test is."""
    name = request.node.name.removeprefix("test_")[:60]
    made = Office.bring_in(served.url, served.dsn, name)
    yield made
    made.close()


class Watched:
    """Fails the test for what the page said on the console, and for requests to other hosts."""

    def __init__(self, page: Page) -> None:
        self.errors: list[str] = []
        self.hosts: set[str] = set()
        page.on("console", self._said)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", self._asked)

    def _said(self, message: ConsoleMessage) -> None:
        if message.type in ("error", "warning") and "GPU stall" not in message.text:
            self.errors.append(message.text)

    def _asked(self, request: Request) -> None:
        if not request.url.startswith(("data:", "blob:")):
            self.hosts.add(request.url.split("/")[2])


@pytest.fixture
def size() -> tuple[int, int]:
    """Width and height of the window [px]; what is no wider than a tablet is touched. Tests give others by this name."""
    return DESKTOP


@pytest.fixture
def theme() -> str:
    return "light"


@pytest.fixture
def reader() -> dict[str, Any]:
    """What else is told of who looks at it, as Playwright's contexts take it: language, zone, permissions."""
    return {}


@pytest.fixture
def context(
    browser: Browser, size: tuple[int, int], theme: str, reader: dict[str, Any]
) -> Iterator[BrowserContext]:
    width, height = size
    is_touched = width <= LARGEST_TOUCHED_PX
    made = browser.new_context(
        viewport={"width": width, "height": height},
        is_mobile=is_touched,
        has_touch=is_touched,
        reduced_motion="reduce",
        color_scheme="dark" if theme == "dark" else "light",
        **reader,
    )
    made.set_default_timeout(PATIENCE_MS)
    yield made
    made.close()


@pytest.fixture
def page(context: BrowserContext, request: pytest.FixtureRequest) -> Iterator[Page]:
    """A page that has not gone anywhere yet."""
    opened = context.new_page()
    watched = Watched(opened)
    yield opened
    take_picture(opened, request)
    assert len(watched.hosts) <= 1, "the page asks other hosts"
    if "fails_requests" not in request.fixturenames:
        assert watched.errors == []


@pytest.fixture
def look(page: Page, request: pytest.FixtureRequest) -> Callable[[str], list[str]]:
    """Looks at a state of the page: what is wrong with it, and a picture of it where they are asked for."""

    def looked(state: str) -> list[str]:
        take_picture(page, request, f"-{state}")
        return flaws(page)

    return looked


@pytest.fixture
def fails_requests() -> None:
    """For tests in which requests fail, of which the browser tells on the console."""


@pytest.fixture
def plan(page: Page, office: Office) -> Plan:
    """The page with the office on it, live."""
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    return Plan.measured(page)
