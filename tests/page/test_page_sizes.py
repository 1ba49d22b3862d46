"""The page on phones and tablets: nothing is off the screen, the map is seen, and fingers hit what they want."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from measured import FINGER_PX, OFF_THE_SCREEN, PHONE, SMALL_TARGETS, TABLET
from playwright.sync_api import Page, expect
from served import Office

WIDTHS = (320, 360, 390, 430, 540, 640, 641, 768, 820, 912, 1024)
WINDOWS = ((320, 568), (390, 664), PHONE, (844, 390), (768, 1024), TABLET, (1024, 768))
TABS = ("details", "events", "edit", "rules", "queries", "import")

MAP_SEEN = """() => {
    const box = document.getElementById("stage").getBoundingClientRect();
    let seen = 0, all = 0;
    for (let x = 4; x < innerWidth; x += 8) for (let y = 4; y < innerHeight; y += 8) {
        all += 1;
        seen += document.elementFromPoint(x, y)?.closest("#scene") ? 1 : 0;
    }
    return seen / all;
}"""

on_a_phone = pytest.mark.parametrize("size", [PHONE], ids=["phone"])


@pytest.fixture
def opened(page: Page, office: Office) -> Page:
    """The office on a touch screen of a size, with somebody in it and an event."""
    ann = office.track("ann")
    office.see(ann, 3, 2, after_s=-2)
    office.happen("entered", ann, "kitchen", after_s=-2)
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    return page


def states(page: Page) -> Iterator[str]:
    """Brings the page into each of its states, in turn."""
    yield "first"
    for tab in TABS:
        page.locator(f"#tab-{tab}").tap()
        expect(page.locator(f"#panel-{tab}")).to_be_visible()
        page.wait_for_load_state("networkidle")
        yield tab
    page.locator("#tab-rules").tap()
    page.get_by_role("button", name="Write a rule").tap()
    yield "writing"
    page.get_by_role("button", name="Back").tap()
    page.locator("#tab-events").tap()
    page.locator("#event-list").get_by_role("button").first.tap()
    expect(page.locator("#status")).to_have_attribute("data-state", "past")
    yield "event"
    page.keyboard.press("Escape")
    page.locator("#panel-details").get_by_role("button", name="Kitchen", exact=True).tap()
    yield "room"
    page.get_by_role("button", name="Close the panels").tap()
    yield "closed"
    page.get_by_role("button", name="Keys and help").tap()
    expect(page.get_by_role("dialog")).to_be_visible()
    yield "help"


@on_a_phone
def test_no_width_scrolls_sideways(opened: Page) -> None:
    found: dict[str, list[str]] = {}
    for state in states(opened):
        for width in WIDTHS:
            opened.set_viewport_size({"width": width, "height": PHONE[1]})
            if off := opened.evaluate(OFF_THE_SCREEN):
                found[f"{state} at {width}"] = off
        opened.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert found == {}


@pytest.mark.parametrize("size", WINDOWS, ids=str)
def test_half_of_what_is_seen_is_the_map(opened: Page) -> None:
    assert opened.evaluate(MAP_SEEN) >= 0.5


@pytest.mark.parametrize("size", [PHONE, TABLET, (844, 390), (320, 568)], ids=str)
def test_a_finger_hits_every_target(opened: Page) -> None:
    found = {state: opened.evaluate(SMALL_TARGETS, FINGER_PX) for state in states(opened)}
    assert found == {state: [] for state in found}


@on_a_phone
def test_the_sheet_is_pulled_up_and_down(opened: Page) -> None:
    panel, bar = opened.locator("#panel-details"), opened.locator("#tabs")
    fingers = opened.context.new_cdp_session(opened)
    expect(opened.get_by_role("tabpanel")).to_have_count(0)
    opened.locator("#tab-details").tap()
    expect(panel).to_be_visible()

    def pull(to_y: float) -> None:
        box = bar.bounding_box()
        assert box is not None
        ways = [box["y"] + 20 + (to_y - box["y"] - 20) * part / 4 for part in range(5)]
        for kind, y in [("touchStart", ways[0]), *(("touchMove", y) for y in ways[1:]), ("touchEnd", None)]:
            points = [] if y is None else [{"x": box["x"] + 60, "y": y}]
            fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    pull(200)
    box = opened.locator("#side").bounding_box()
    assert box is not None
    assert box["height"] > 0.7 * PHONE[1]
    pull(PHONE[1] - 10)
    expect(panel).to_be_hidden()
