"""Whatever is shown is in the address: reloaded or sent, it gives the same picture."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread
from measured import DESKTOP, PHONE, flaws, in_every_size
from patience import PATIENCE_S, until
from playwright.sync_api import BrowserContext, Page, Route, expect
from served import Office, Served, brought_in, house

COPY = "Copy a link to what is shown"
Pixels = np.ndarray[Any, np.dtype[np.float32]]
TWO_FRAMES = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"


@pytest.fixture
def home(served: Served, request: pytest.FixtureRequest) -> Iterator[Office]:
    """Two storeys, on which two people were on a winter's day, and an event."""
    name = request.node.name.removeprefix("test_")[:60]
    ground = (("cellar", 0, 0, 8, 4), ("hall", 8, 0, 12, 4))
    brought_in(served, name, house(("ground", 0, ground), ("1. Stock", 3, (("attic", 0, 0, 8, 4),))))
    found = Office.at(served, name)
    found.now = datetime(2026, 1, 5, 9, tzinfo=UTC)
    ann = found.track("ann")
    for second in range(0, 100, 10):
        found.see(ann, 1 + second / 10, 2, after_s=second)
    found.happen("entered", ann, "hall", after_s=70)
    yield found
    found.close()


@dataclass
class Window:
    page: Page

    def picture(self) -> Pixels:
        self.page.mouse.move(0, 0)
        self.page.evaluate("document.activeElement.blur()")
        self.page.evaluate(TWO_FRAMES)
        pixels: Pixels = imread(BytesIO(self.page.screenshot()))
        return pixels

    def at_rest(self) -> Pixels:
        """The picture as soon as two are alike."""
        return self._until(are_alike)

    def becomes(self, wanted: Pixels) -> None:
        self._until(lambda picture, _: are_alike(picture, wanted))

    def _until(self, is_there: Callable[[Pixels, Pixels], bool]) -> Pixels:
        until_s = time.monotonic() + PATIENCE_S
        before = self.picture()
        while not is_there(picture := self.picture(), before):
            assert time.monotonic() < until_s, f"the picture is another one at {self.page.url}"
            before = picture
        return picture


def are_alike(one: Pixels, other: Pixels) -> bool:
    """But for the edges of what lies a part of a pixel beside."""
    differs = (np.abs(one - other) > 0.25).any(axis=-1)
    return bool(differs.mean() < 0.0005)


@pytest.fixture
def reader() -> dict[str, Any]:
    return {"permissions": ["clipboard-read", "clipboard-write"]}


def opened(context: BrowserContext, address: str) -> Window:
    page = context.new_page()
    page.goto(address)
    expect(page.locator("#status")).to_have_attribute("data-state", re.compile("live|past"))
    return Window(page)


def a_moment_of_somebody(page: Page) -> None:
    page.locator("#tab-details").click()
    page.get_by_label("Find on the map").fill("an")
    page.locator("#panel-details").get_by_role("button", name="ann").click()
    page.get_by_label("Where at").fill("09:00:45")
    expect(page.locator("#where-then")).to_contain_text("ann was in")


def an_event_from_near(page: Page) -> None:
    page.get_by_role("button", name="Nearer").click()
    page.get_by_role("button", name="Longer time").click()
    page.locator("#tab-events").click()
    page.locator("#event-list").get_by_role("button").click()
    expect(page.locator("#panel-details h2")).to_have_text("ann entered hall")


def another_storey(page: Page) -> None:
    page.get_by_role("button", name="1. Stock").click()
    page.locator("#tab-details").click()
    page.get_by_label("Find on the map").fill("att")
    page.locator("#panel-details").get_by_role("button", name="attic").click()
    page.get_by_role("button", name="Close the panels").click()


def all_storeys_turned(page: Page) -> None:
    page.get_by_role("button", name="All storeys").click()
    page.get_by_role("button", name="Pull apart").click()
    page.locator("#stage").focus()
    page.keyboard.press("Shift+ArrowLeft")
    page.keyboard.press("ArrowUp")
    page.locator("#tab-queries").click()


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
@pytest.mark.parametrize(
    "bring", [a_moment_of_somebody, an_event_from_near, another_storey, all_storeys_turned]
)
def test_a_link_gives_the_same_picture(
    context: BrowserContext, home: Office, bring: Callable[[Page], None]
) -> None:
    window = opened(context, home.page)
    bring(window.page)
    wanted = window.at_rest()
    window.page.reload()
    window.becomes(wanted)
    window.page.get_by_role("button", name=COPY).click()
    expect(window.page.get_by_text("The link to what is shown is copied.")).to_be_visible()
    link = window.page.evaluate("navigator.clipboard.readText()")
    assert link == window.page.url
    opened(context, link).becomes(wanted)
    other = opened(context, f"{home.url}/#map={home.name}")
    other.at_rest()
    other.page.evaluate("(link) => (location.href = link)", link)
    other.becomes(wanted)


def test_a_link_is_copied_where_there_is_no_clipboard(context: BrowserContext, office: Office) -> None:
    window = opened(context, office.page)
    page = window.page
    page.evaluate("Object.defineProperty(navigator, 'clipboard', {value: undefined})")
    page.get_by_role("button", name=COPY).click()
    expect(page.get_by_text("The link to what is shown is copied.")).to_be_visible()
    page.locator("#tab-details").click()
    link = page.url
    page.get_by_label("Find on the map").click()
    page.keyboard.press("Control+v")
    expect(page.get_by_label("Find on the map")).to_have_value(link.replace("&tab=details", ""))


def test_what_an_address_says_wrongly_is_as_at_first(context: BrowserContext, office: Office) -> None:
    wrong = "&at=noon&storey=none&view=up&track=x&tab=x&time=1/0&eye=1,2"
    page = opened(context, office.page + wrong).page
    expect(page.locator("#status")).to_have_attribute("data-state", "live")
    expect(page.locator("#tab-events")).to_have_attribute("aria-selected", "true")
    expect(page).to_have_url(re.compile("#map=[^&]*$"))
    stamp = "2026-01-05T09:00:00Z"
    page.evaluate(f"location.hash = 'map={office.name}&event=0f8e@{stamp}&at={stamp}'")
    expect(page.get_by_text("The event of this link is no longer there.")).to_be_visible()
    expect(page.locator("#status")).to_contain_text("09:00:00")


@in_every_size
def test_everybody_can_copy_a_link(context: BrowserContext, home: Office, size: tuple[int, int]) -> None:
    page = opened(context, home.page).page
    page.get_by_role("button", name=COPY).click()
    assert flaws(page) == []
    if size == PHONE:
        for width in (320, 360):
            page.set_viewport_size({"width": width, "height": size[1]})
            assert flaws(page) == []


@pytest.mark.parametrize("address", ["", "#map={name}", "#map={name}&tab=rules"], ids=["none", "map", "tab"])
def test_what_is_chosen_before_the_map_is_there_stays(page: Page, home: Office, address: str) -> None:
    held: list[Route] = []
    page.route(re.compile(r"/maps(\?|$)"), lambda route: held.append(route))  # noqa: PLW0108  (playwright asks for a function)
    page.goto(f"{home.url}/{address.format(name=home.name)}")
    page.locator("#tab-import").click()
    page.wait_for_function("() => document.querySelector('#tab-import').ariaSelected === 'true'")
    until(lambda: page.wait_for_timeout(10) or held)
    for each in held:
        each.continue_()
    page.wait_for_selector("#status[data-state=live]")
    expect(page.locator("#tab-import")).to_have_attribute("aria-selected", "true")
    expect(page).to_have_url(re.compile("tab=import"))
