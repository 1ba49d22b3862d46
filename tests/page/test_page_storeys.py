"""The storeys of a building: how many people are on each, and all of them in space, pulled apart."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import pytest
from measured import in_every_size, in_every_theme
from plan import RECORD, until_written
from playwright.sync_api import Page, expect
from served import Office, Served, brought_in, house

BOX = (0.0, 0.0, 8.0, 4.0)


@pytest.fixture
def tower(served: Served, request: pytest.FixtureRequest) -> Iterator[Office]:
    """Two rooms on each other, three metres apart; ann and bob are below, and bob's track is in two rooms."""
    name = request.node.name.removeprefix("test_")[:60]
    rooms = ((("cellar", *BOX), ("corner of the cellar", 0, 0, 2, 2)), (("attic", *BOX),))
    brought_in(served, name, house(("ground", 0, rooms[0]), ("first", 3, rooms[1])))
    found = Office.at(served, name)
    found.see(found.track("ann"), 7, 3.5, after_s=-5, z_m=0)
    found.see(found.track("bob"), 1, 1, after_s=-5, z_m=0)
    yield found
    found.close()


def opened(page: Page, tower: Office) -> None:
    page.add_init_script(f"({RECORD})()")
    page.goto(tower.page)
    page.wait_for_selector("#status[data-state=live]")


def test_storeys_never_cover_each_other(page: Page, tower: Office) -> None:
    opened(page, tower)
    until_written(page, "cellar")
    page.get_by_role("button", name="All storeys").click()
    expect(page.locator("#view-space")).to_have_attribute("aria-pressed", "true")
    for _ in range(3):
        page.get_by_role("button", name="Farther").click()
    until_written(page, "attic")
    page.locator("#view-plan").click()
    expect(page.get_by_role("button", name="ground")).to_have_attribute("aria-pressed", "true")
    # what was asked for in 3D may be drawn in one frame more
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.evaluate("window.forget()")
    page.get_by_role("button", name="Nearer").click()
    until_written(page, "cellar")
    assert "attic" not in page.evaluate("[...window.written.keys()]")


@in_every_theme
@in_every_size
def test_each_storey_says_how_many_are_on_it(
    page: Page, tower: Office, look: Callable[[str], list[str]]
) -> None:
    opened(page, tower)
    storeys = page.locator("#storeys").get_by_role("button")
    expect(storeys).to_have_text(["All storeyspeople:2", "firstpeople:0", "groundpeople:2"])
    cid = tower.track("cid")
    tower.see(cid, 1, 3.5, after_s=-4, z_m=3)
    expect(storeys).to_have_text(["All storeyspeople:3", "firstpeople:1", "groundpeople:2"])
    page.get_by_role("button", name="first people: 1").click()
    until_written(page, "attic")
    assert look("first") == []
    page.get_by_role("button", name="All storeys people: 3").click()
    page.get_by_role("button", name="Pull apart").click()
    assert look("apart") == []


def test_storeys_pulled_apart_are_all_seen_and_hit(page: Page, tower: Office) -> None:
    opened(page, tower)
    page.get_by_role("button", name="All storeys").click()
    apart = page.get_by_role("button", name="Pull apart")
    apart.click()
    expect(page).to_have_url(re.compile("storeys=apart"))
    page.reload()
    expect(apart).to_have_attribute("aria-pressed", "true")
    at = {name: place_of(page, name) for name in ("attic", "cellar")}
    assert at["attic"][1] < at["cellar"][1]
    for name, place in at.items():
        page.mouse.click(*place)
        expect(page.locator("#panel-details h2")).to_have_text(name)
    apart.click()
    for _ in range(3):
        page.get_by_role("button", name="Farther").click()
    page.evaluate("window.forget()")
    page.get_by_role("button", name="Farther").click()
    page.mouse.click(*place_of(page, "attic"))
    expect(page.locator("#panel-details h2")).to_have_text("attic")


def place_of(page: Page, name: str) -> tuple[float, float]:
    """The pixel on which the name of a room lies, which is on the picture."""
    until_written(page, name)
    written = page.evaluate(f"window.written.get('{name}')")
    box = page.locator("#stage").bounding_box()
    assert box is not None
    assert 0 < written["y"] < box["height"]
    return box["x"] + written["x"], box["y"] + written["y"]
