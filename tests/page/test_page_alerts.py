"""Of an event one is told again: by this browser, or at an address."""

from __future__ import annotations

import re

from measured import flaws, in_every_size
from playwright.sync_api import Page, expect
from served import Office
from test_page_rule_writing import TOLD

LAB = (11.0, 2.0)


def told_of(page: Page, office: Office) -> int:
    """The page at an event of ann in the lab, with what it can tell of opened; ann's track."""
    ann = office.track("ann")
    office.see(ann, *LAB, after_s=-20)
    office.happen("entered", ann, "lab", after_s=-20)
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    page.locator("#tab-events").click()
    page.locator("#event-list").get_by_role("button").click()
    page.get_by_text("Tell me when this happens again").click()
    return ann


@in_every_size
def test_this_browser_tells_of_the_same_again(page: Page, office: Office) -> None:
    page.add_init_script(TOLD)
    ann = told_of(page, office)
    page.locator("#panel-details").get_by_label("Where").select_option("wherever it is")
    button = page.get_by_role("button", name="In this browser, while the page is open")
    button.click()
    expect(button).to_have_attribute("aria-pressed", "true")
    assert flaws(page) == []
    office.happen("entered", office.track("bob"), "kitchen", after_s=1)
    office.happen("left", ann, "kitchen", after_s=2)
    office.happen("entered", ann, "kitchen", after_s=3)
    only_hers = re.compile(r"^ann entered Kitchen \([^)]*\)\.$")
    expect(page.locator("html")).to_have_attribute("data-told", only_hers)
    page.reload()
    alerts = page.get_by_role("list", name="Alerts")
    page.get_by_text("Tell me when this happens again").click()
    expect(alerts.get_by_role("listitem")).to_have_count(1)
    alerts.get_by_role("button", name="Remove the alert").click()
    expect(alerts).to_be_hidden()


def test_an_address_is_called_for_the_same(page: Page, office: Office) -> None:
    told_of(page, office)
    page.get_by_label("At an address").fill("https://example.org/semap")
    page.get_by_role("button", name="Make the webhook").click()
    expect(page.get_by_role("status").filter(has_text="Its secret")).to_contain_text("whsec_")
    assert flaws(page) == []
    (made,) = [each for each in office.get("/webhooks")["webhooks"] if each["maps"] == [office.name]]
    assert (made["type"], made["filter"], made["url"]) == (
        "entered",
        "track = 'ann' AND instance = 'lab'",
        "https://example.org/semap",
    )
    webhooks = page.get_by_role("list", name="Webhooks")
    webhooks.get_by_role("button", name="Delete https://example.org/semap").click()
    expect(webhooks).to_be_hidden()
    assert [each for each in office.get("/webhooks")["webhooks"] if each["maps"] == [office.name]] == []
