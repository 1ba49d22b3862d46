"""A day of somebody, also of one who has left: where he was at a time, in which rooms, on which way."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from measured import flaws, in_every_size, in_every_theme
from plan import Plan
from playwright.sync_api import Page, expect
from served import Office

KITCHEN, LAB = (3.0, 2.0), (11.0, 2.0)
NINE = datetime(2026, 1, 5, 9, tzinfo=UTC)
H_S = 3600


@pytest.fixture
def bob(office: Office) -> int:
    """In the kitchen from 9:00:00, in the lab from 9:00:40 to 9:01:00, gone, and back at noon for a minute; Ann is there."""
    office.now = NINE
    bob = office.track("Bob")
    office.see(bob, *KITCHEN, after_s=0)
    office.see(bob, *KITCHEN, after_s=20)
    office.see(bob, *LAB, after_s=40)
    office.see(bob, *LAB, after_s=60)
    office.see(bob, -20, 2, after_s=61)
    office.see(bob, *LAB, after_s=3 * H_S)
    office.leave(bob, *LAB, after_s=3 * H_S + 60)
    ann = office.track("Ann")
    office.see(ann, *KITCHEN, after_s=4 * H_S)
    return bob


def opened(page: Page, office: Office) -> None:
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    if page.locator("#panel-details").is_hidden():
        page.locator("#tab-details").click()


def chosen(page: Page) -> None:
    page.get_by_label("Find on the map").fill("bob")
    page.locator("#panel-details").get_by_role("button", name="Bob").click()


def test_where_somebody_was_at_a_time_in_two_clicks(page: Page, office: Office, bob: int) -> None:
    opened(page, office)
    chosen(page)
    expect(page.locator("#panel-details")).to_contain_text("Has left the map.")
    time = page.get_by_label("Where at")
    time.click()
    answer = page.locator("#where-then")
    for typed, told in {
        "09:00:45": "At 09:00:45 UTC Bob was in Lab, since 09:00:40.",
        "08:59:59": "At 08:59:59 UTC Bob was not seen yet on this day.",
        "09:00:00": "At 09:00:00 UTC Bob was in Kitchen, since 09:00:00.",
        "09:01:01": "At 09:01:01 UTC Bob was in no room.",
        "10:30:00": "At 10:30:00 UTC Bob was not seen; last before that at 09:01:01.",
        "12:00:30": "At 12:00:30 UTC Bob was in Lab, since 12:00:00.",
    }.items():
        time.fill(typed)
        expect(answer).to_have_text(told)
        expect(page.locator("#status")).to_contain_text(typed)
        expect(time).to_be_focused()
    expect(page.locator("#panel-details")).not_to_contain_text("Not on the map")
    stays = page.get_by_role("region", name="Stays").get_by_role("listitem")
    expect(stays).to_have_text(
        ["09:00:00–09:00:40Kitchen40 s", "09:00:40–09:01:01Lab21 s", "12:00:00–12:01:00Lab1 min 00 s"]
    )
    expect(stays.nth(2)).to_have_attribute("aria-current", "time")
    page.get_by_role("button", name="The day before").click()
    expect(page.locator("#panel-details")).to_contain_text("Bob was not seen on this day.")
    page.locator("#panel-details").get_by_label("Day", exact=True).fill("2026-01-05")
    expect(answer).to_have_text("At 12:00:30 UTC Bob was in Lab, since 12:00:00.")


def test_a_click_on_the_day_shows_that_moment(page: Page, office: Office, bob: int) -> None:
    opened(page, office)
    chosen(page)
    box = page.locator(".day-strip .bar").bounding_box()
    assert box is not None
    # from 9 to 13 o'clock
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 10)
    expect(page.locator("#where-then")).to_contain_text("Bob was not seen; last before that at 09:01:01.")
    page.get_by_role("region", name="Stays").get_by_role("button", name="12:00:00").click()
    expect(page.locator("#where-then")).to_have_text("At 12:00:00 UTC Bob was in Lab, since 12:00:00.")


def test_the_way_of_the_day_is_drawn(plan: Plan, office: Office, bob: int) -> None:
    page = plan.page
    x, y = plan.pixel(5.0, 2.0)
    corner = {"x": x - 4, "y": y - 4, "width": 8, "height": 8}

    def picture() -> bytes:
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        return page.screenshot(clip=corner)

    page.locator("#tab-details").click()
    page.get_by_label("Find on the map").fill("bob")
    found = page.locator("#panel-details").get_by_role("button", name="Bob")
    expect(found).to_be_visible()
    page.mouse.move(0, 0)
    without = picture()
    found.click()
    expect(page.get_by_role("region", name="Stays").get_by_role("listitem")).to_have_count(3)
    page.mouse.move(0, 0)
    assert picture() != without
    page.get_by_role("button", name="← all that is on the map").click()
    page.mouse.move(0, 0)
    assert picture() == without


@in_every_theme
@in_every_size
def test_everybody_can_use_a_day(page: Page, office: Office, bob: int) -> None:
    opened(page, office)
    chosen(page)
    page.get_by_label("Where at").fill("09:00:45")
    expect(page.locator("#where-then")).to_contain_text("in Lab")
    assert flaws(page) == []
