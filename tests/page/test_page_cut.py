"""Where the service cannot be asked how it was, the page says so; it never shows an empty building instead."""

from __future__ import annotations

import re
from collections.abc import Iterator
from io import BytesIO

import pytest
from PIL import Image
from plan import Plan
from playwright.sync_api import Locator, Page, expect
from served import Office, Served, free_port
from wire import CUTS, Wire

KITCHEN, LAB = (3.0, 2.0), (11.0, 2.0)
CORNER = (0.4, 0.4)
"""Of the kitchen, where neither a name nor anybody is."""

# Ann is somewhere at each of the moments that are looked at: a list without her is made up.
WATCH = """() => {
    window.madeUp = [];
    const look = () => {
        const details = document.getElementById("panel-details");
        const isList = details.querySelector("input[type=search]") !== null;
        const says = details.innerText.includes("ann") || details.querySelector(".unread") !== null;
        if (!details.hidden && isList && !says) window.madeUp.push(details.innerText);
    };
    new MutationObserver(look).observe(document.body, {subtree: true, childList: true, characterData: true});
}"""


@pytest.fixture
def wire(served: Served) -> Iterator[Wire]:
    with Wire(served.port, free_port()) as laid:
        yield laid


def who_is_here(page: Page) -> Locator:
    return page.locator("#panel-details section").filter(has_text="Who is here")


def looked_at(page: Page, office: Office, wire: Wire) -> None:
    ann = office.track("ann")
    office.see(ann, *KITCHEN, after_s=-60)
    office.see(ann, *LAB, after_s=-30)
    office.happen("entered", ann, "kitchen", after_s=-60)
    office.happen("entered", ann, "lab", after_s=-30)
    page.goto(office.page.replace(office.url, f"http://127.0.0.1:{wire.port}"))
    page.wait_for_selector("#status[data-state=live]")
    page.locator("#tab-events").click()
    expect(page.locator("#event-list").get_by_role("button")).to_have_count(2)
    page.evaluate(WATCH)


def look_at(page: Page, place: str) -> None:
    """Goes to the moment at which Ann came to a place, and lists who is where then."""
    page.locator("#tab-events").click()
    page.locator("#event-list").get_by_role("button").filter(has_text=place).click()
    page.keyboard.press("Escape")


def cut_and_heal(page: Page, wire: Wire, times: int) -> None:
    for turn in range(times):
        place = ("Lab", "Kitchen")[turn % 2]
        wire.cut(CUTS[turn % len(CUTS)])
        look_at(page, place)
        expect(page.locator("#unread")).to_be_visible()
        expect(who_is_here(page)).to_have_count(0)
        expect(page.locator("#panel-details li").filter(has_text=re.compile("^Kitchen"))).to_have_text(
            "Kitchen"
        )
        wire.mend()
        expect(page.locator("#unread")).to_have_count(0)
        expect(who_is_here(page).get_by_role("listitem")).to_have_text(f"ann{place}")
    assert page.evaluate("window.madeUp") == []


def test_no_past_is_made_up(page: Page, office: Office, wire: Wire, fails_requests: None) -> None:
    looked_at(page, office, wire)
    cut_and_heal(page, wire, times=6)


@pytest.mark.slow
def test_no_past_is_made_up_in_a_hundred_cuts(
    page: Page, office: Office, wire: Wire, fails_requests: None
) -> None:
    looked_at(page, office, wire)
    cut_and_heal(page, wire, times=100)


def test_what_could_not_be_read_is_grey(page: Page, office: Office, wire: Wire, fails_requests: None) -> None:
    looked_at(page, office, wire)
    look_at(page, "Kitchen")
    expect(who_is_here(page)).to_contain_text("Kitchen")
    page.locator("#go-live").click()
    expect(page.locator("#status")).to_have_attribute("data-state", "live")
    where = Plan.measured(page).pixel(*CORNER)
    page.locator("#tab-details").click()
    empty = colour_at(page, where)
    wire.cut("reset")
    look_at(page, "Lab")
    expect(page.locator("#unread")).to_contain_text("could not be read")
    page.mouse.move(*where)
    expect(page.locator(".hover-card")).to_have_text("Kitchen not known")
    assert colour_at(page, where) == theme_colour(page, "--map-unread") != empty
    wire.mend()
    expect(page.locator("#unread")).to_have_count(0)
    expect(page.locator("#unread-time")).to_have_count(0)
    page.mouse.move(where[0] + 1, where[1])
    expect(page.locator(".hover-card")).to_have_text("Kitchen 0 in it")
    assert colour_at(page, where) == empty


def theme_colour(page: Page, name: str) -> tuple[int, int, int]:
    text: str = page.evaluate(
        "(name) => getComputedStyle(document.documentElement).getPropertyValue(name)", name
    )
    red, green, blue = bytes.fromhex(text.strip().removeprefix("#"))
    return red, green, blue


def colour_at(page: Page, where: tuple[float, float]) -> tuple[int, int, int]:
    clip = {"x": round(where[0]), "y": round(where[1]), "width": 1, "height": 1}
    picture = Image.open(BytesIO(page.screenshot(clip=clip)))  # type: ignore[arg-type]
    red, green, blue = picture.convert("RGB").getpixel((0, 0))  # type: ignore[misc]
    return red, green, blue
