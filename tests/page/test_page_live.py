"""What moves and happens is seen at once; the past can be looked at; a service that was killed is awaited."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest
from plan import Plan
from playwright.sync_api import Locator, Page, expect
from served import Office, Served

KITCHEN, LAB = (3.0, 2.0), (11.0, 2.0)


def who_is_here(page: Page) -> Locator:
    return page.locator("#panel-details section").filter(has_text="Who is here")


def test_a_track_moves_on_the_plan(plan: Plan, office: Office) -> None:
    page = plan.page
    page.locator("#tab-details").click()
    ann = office.track("ann")
    office.see(ann, *KITCHEN, after_s=0)
    expect(who_is_here(page).get_by_role("listitem")).to_have_text("annKitchen")
    plan.finds(*KITCHEN, "ann")
    office.see(ann, *LAB, after_s=1)
    expect(who_is_here(page).get_by_role("listitem")).to_have_text("annLab")
    plan.finds(*LAB, "ann")
    plan.finds(*KITCHEN, "Kitchen")


def test_an_event_arrives_and_leads_back_to_its_moment(plan: Plan, office: Office) -> None:
    page = plan.page
    ann = office.track("ann")
    office.see(ann, *KITCHEN, after_s=-40)
    office.see(ann, *LAB, after_s=-20)
    page.locator("#tab-events").click()
    stamp = office.happen("entered", ann, "lab", after_s=-20)
    event = page.locator("#event-list").get_by_role("button")
    expect(event).to_have_count(1)
    expect(event).to_contain_text("ann entered Lab")
    event.click()
    expect(page.locator("#status")).to_have_attribute("data-state", "past")
    expect(page.locator("#panel-details h2")).to_have_text("ann entered Lab")
    slider = page.get_by_role("slider", name="Moment that is shown")
    expect(slider).to_have_attribute("aria-valuenow", str(int(stamp.timestamp())))
    plan.finds(*LAB, "ann")


def test_scrub_back_and_return_to_live(plan: Plan, office: Office) -> None:
    page = plan.page
    ann = office.track("ann")
    office.see(ann, *KITCHEN, after_s=-60)
    office.see(ann, *LAB, after_s=-1)
    page.locator("#tab-details").click()
    expect(who_is_here(page)).to_contain_text("Lab")
    slider = page.get_by_role("slider", name="Moment that is shown")
    expect(slider).not_to_have_attribute("aria-valuetext", "nothing has happened yet")
    slider.focus()
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#status")).to_have_attribute("data-state", "past")
    for _ in range(20):
        if "Kitchen" in who_is_here(page).inner_text():
            break
        page.keyboard.press("Shift+ArrowLeft")
        page.wait_for_load_state("networkidle")
    expect(who_is_here(page)).to_contain_text("Kitchen")
    page.locator("#go-live").click()
    expect(page.locator("#status")).to_have_attribute("data-state", "live")
    expect(who_is_here(page)).to_contain_text("Lab")


def test_events_are_told_in_sentences(plan: Plan, office: Office) -> None:
    page = plan.page
    bob = office.track("Bob")
    office.see(bob, *LAB, after_s=-20)
    office.happen(
        "left_then_closed", bob, "lab_door", after_s=-20, key={"room": "lab"}, measures={"gap_s": 1.1}
    )
    page.locator("#tab-events").click()
    event = page.locator("#event-list").get_by_role("button")
    expect(event).to_contain_text("Bob left Lab and closed the door, 1.1 s later")
    event.click()
    details = page.locator("#panel-details")
    expect(details.locator("h2")).to_have_text("Bob left Lab and closed the door, 1.1 s later")
    expect(details.get_by_role("row", name="Gap")).to_contain_text("1.1 s")
    page.keyboard.press("Escape")
    page.locator("#tab-details").click()
    details.get_by_role("button", name="Lab", exact=True).click()
    for said in (details.inner_text(), page.locator("#event-list").inner_text()):
        for word in ("left_then_closed", "gap_s", "room_visits", "Known to", "Number", "who was where"):
            assert word not in said


def test_who_has_left_is_found(plan: Plan, office: Office) -> None:
    page = plan.page
    office.now = datetime(2026, 1, 5, 9, tzinfo=UTC)
    ann = office.track("Ann Arbor")
    office.see(ann, *KITCHEN, after_s=-60)
    office.see(ann, *LAB, after_s=-30)
    office.leave(ann, *LAB, after_s=-20)
    office.happen("left", ann, "lab", after_s=-20)
    stays = page.get_by_role("region", name="Stays").get_by_role("listitem")

    page.locator("#tab-events").click()
    page.locator("#event-list").get_by_role("button").click()
    page.locator("#panel-details").get_by_role("button", name="Ann Arbor", exact=True).click()
    expect(stays).to_have_count(2)
    expect(stays.nth(0)).to_contain_text("Kitchen30 s")
    expect(stays.nth(1)).to_contain_text("Lab10 s")
    expect(page.locator("#panel-details")).to_contain_text("Last seen")

    page.locator("#go-live").click()
    page.keyboard.press("Escape")
    page.get_by_label("Find on the map").fill("arb")
    page.locator("#panel-details").get_by_role("button", name="Ann Arbor", exact=True).click()
    expect(page.locator("#panel-details")).to_contain_text("Has left the map.")
    stays.nth(0).get_by_role("button").first.click()
    expect(page.locator("#status")).to_have_attribute("data-state", "past")
    plan.finds(*KITCHEN, "Ann Arbor")


@pytest.mark.slow
def test_a_killed_service_is_awaited(page: Page, page_database: str, fails_requests: None) -> None:
    own = Served(page_database)
    try:
        own.start()
        office = Office.bring_in(own.url, own.dsn, "killed")
        ann = office.track("ann")
        office.see(ann, *KITCHEN, after_s=0)
        page.goto(office.page)
        page.locator("#tab-details").click()
        expect(who_is_here(page)).to_contain_text("Kitchen")
        own.kill()
        expect(page.locator("#status")).to_have_attribute("data-state", "disconnected")
        office.see(ann, *LAB, after_s=1)
        office.happen("entered", ann, "lab", after_s=1)
        own.start()
        expect(page.locator("#status")).to_have_attribute("data-state", "resumed", timeout=30_000)
        expect(who_is_here(page)).to_contain_text("Lab")
        page.locator("#tab-events").click()
        expect(page.locator("#event-list").get_by_role("button")).to_have_count(1)
        office.close()
    finally:
        own.stop()
