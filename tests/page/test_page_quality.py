"""How heavy the page is, how soon there is a picture, and whether everybody can use it (axe)."""

from __future__ import annotations

import gzip
import re

import pytest
from measured import flaws, in_every_size, in_every_theme
from playwright.sync_api import Page, expect
from semap_service.http.page import FILES
from served import Office, Served

HEAVIEST_BYTES = 300_000
FIRST_PICTURE_S = 2.0
FIRST_PICTURE = """() => new Promise((resolve) => {
    const told = (found) => resolve(found.getEntries().at(-1).startTime);
    new PerformanceObserver(told).observe({type: "largest-contentful-paint", buffered: true});
})"""

STATES = {
    "plan": "#tab-details",
    "events": "#tab-events",
    "edit": "#tab-edit",
    "rules": "#tab-rules",
    "queries": "#tab-queries",
    "import": "#tab-import",
}


def test_the_page_is_light() -> None:
    sent = [file for file in FILES.rglob("*") if file.is_file() and file.suffix not in (".br", ".gz", ".map")]
    packed = {file.name: len(gzip.compress(file.read_bytes())) for file in sent}
    languages = [packed.pop(name) for name in list(packed) if re.match(r"(de|ar)-[^/]*\.js", name)]
    assert len(languages) == 2
    # A reader is sent one language.
    assert sum(packed.values()) + max(languages) <= HEAVIEST_BYTES


def test_the_browser_is_sent_what_is_packed(page: Page, served: Served) -> None:
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    sizes: list[int] = []
    session.on("Network.loadingFinished", lambda event: sizes.append(event["encodedDataLength"]))
    page.goto(served.url)
    page.wait_for_selector("#tabs [role=tab]")
    assert 0 < sum(sizes) <= HEAVIEST_BYTES


@pytest.mark.slow
def test_the_first_picture_comes_soon(page: Page, served: Served, office: Office) -> None:
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    assert page.evaluate(FIRST_PICTURE) <= FIRST_PICTURE_S * 1000


@in_every_theme
@in_every_size
def test_everybody_can_use_it(page: Page, office: Office) -> None:
    ann = office.track("ann")
    office.see(ann, 3, 2, after_s=-2)
    office.happen("entered", ann, "kitchen", after_s=-2)
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    found: dict[str, list[str]] = {}
    for state, tab in STATES.items():
        page.locator(tab).click()
        found[state] = flaws(page)
    page.locator("#tab-rules").click()
    page.get_by_role("button", name="Write a rule").click()
    page.get_by_label("The rule as YAML").fill("name: a\ninput: track_in_room\nemit: {begun: b}\n")
    expect(page.locator("#rule-verdict")).to_contain_text("there is no such edge")
    found["writing"] = flaws(page)
    page.keyboard.press("Escape")
    page.locator("#stage").focus()
    page.keyboard.press("r")
    found["drawing"] = flaws(page)
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    expect(page.get_by_role("dialog")).to_be_visible()
    found["dialog"] = flaws(page)
    page.keyboard.press("Escape")
    page.get_by_role("slider", name="Moment that is shown").focus()
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#status")).to_have_attribute("data-state", "past")
    found["past"] = flaws(page)
    assert found == {state: [] for state in found}
