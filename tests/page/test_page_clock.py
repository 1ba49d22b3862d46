"""One clock for the whole page, with its zone; and how old what is called live is."""

from __future__ import annotations

import re
from datetime import UTC, timedelta, timezone

import pytest
from playwright.sync_api import Page, expect
from served import Office

TOKYO = timezone(timedelta(hours=9), "GMT+9")
TEN_MONTHS_S = 305 * 86_400


@pytest.mark.parametrize("reader", [{"timezone_id": "Asia/Tokyo"}], ids=["Tokyo"])
def test_every_time_has_its_zone(page: Page, office: Office) -> None:
    ann = office.track("ann")
    office.see(ann, 3, 2, after_s=-TEN_MONTHS_S)
    stamp = office.happen("entered", ann, "kitchen", after_s=-TEN_MONTHS_S)
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    expect(page.locator("#freshness")).to_have_text("newest: 10 months ago")
    expect(page.locator("#status")).to_have_class(re.compile("stale"))
    page.locator("#tab-events").click()
    page.locator("#event-list").get_by_role("button").click()
    page.get_by_role("button", name="Why did it fire?").click()
    why = page.locator("pre.why")
    switch = page.get_by_role("button", name="UTC", exact=True)
    for zone, is_utc in ((TOKYO, False), (UTC, True), (TOKYO, False)):
        expect(switch).to_have_attribute("aria-pressed", str(is_utc).lower())
        text = f"{stamp.astimezone(zone):%Y-%m-%d %H:%M:%S}.0 {stamp.astimezone(zone):%Z}"
        for place in ("#status", "#shown-moment", "#panel-details table"):
            expect(page.locator(place).first).to_contain_text(text)
        expect(why).to_contain_text(text)
        expect(why).not_to_contain_text(re.compile(r"\d{2}:\d{2}(:[\d.]+)?Z"))
        expect(page.locator("#event-list time")).to_have_text(text.split(" ", 1)[1])
        switch.click()
    page.reload()
    expect(switch).to_have_attribute("aria-pressed", "true")
