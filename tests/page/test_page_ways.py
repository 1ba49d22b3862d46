"""Ways through the page lead where they seem to lead, and names are where they can be read."""

from __future__ import annotations

from typing import Any

import pytest
from plan import RECORD, Plan, until_written
from playwright.sync_api import Page, expect
from served import Office, Served, brought_in, building

LONG = "Meeting room of the department for the maintenance of lifts, doors and windows of the northern wing"
ARABIC = "غرفة الاجتماعات الكبيرة في الطابق الأول من المبنى الشمالي"
MOST_TAB_STOPS = 40


def test_a_link_to_a_map_that_is_not_there_shows_no_other(page: Page, office: Office) -> None:
    page.goto(f"{office.url}/#map=not%20there")
    expect(page.locator("#problem")).to_contain_text("There is no map not there here.")
    expect(page.locator("#map-choice")).to_have_value("")
    page.get_by_role("button", name="Try again").click()
    expect(page.locator("#problem")).to_contain_text("There is no map not there here.")
    page.evaluate("(name) => (location.hash = `map=${name}`)", office.name)
    page.wait_for_selector("#status[data-state=live]")
    expect(page.locator("#map-choice")).to_have_value(office.name)


def test_the_rule_of_an_event_is_opened(plan: Plan, office: Office) -> None:
    page = plan.page
    ann = office.track("ann")
    office.see(ann, 3, 2, after_s=-5)
    office.happen("entered", ann, "kitchen", after_s=-5)
    page.locator("#tab-events").click()
    page.locator("#event-list").get_by_role("button").click()
    page.get_by_role("button", name="The rule").click()
    text = page.get_by_label("The rule as YAML")
    expect(text).to_have_value(
        "name: room_visits\ninput: track_in_room\nemit:\n  began: entered\n  ended: left\n"
    )
    page.get_by_role("button", name="Back").click()
    page.get_by_role("button", name="Write a rule").click()
    text.fill("name: mine\n")
    page.locator("#tab-details").click()
    page.get_by_role("button", name="The rule").click()
    page.get_by_role("dialog").get_by_role("button", name="Cancel").click()
    expect(text).to_have_value("name: mine\n")


def test_a_drawing_goes_with_its_panel_and_comes_back(plan: Plan) -> None:
    page = plan.page
    drawn = page.locator(".sketch .side, .sketch .area, .sketch circle")
    page.keyboard.press("r")
    for x_m, y_m in ((13, 9), (15, 9), (15, 10)):
        plan.click(x_m, y_m)
    page.get_by_text("Corners in metres").click()
    corners = page.locator("table.corners tbody tr")
    expect(corners).to_have_count(3)
    expect(drawn).not_to_have_count(0)
    page.locator("#tab-details").click()
    expect(drawn).to_have_count(0)
    page.locator("#tab-edit").click()
    expect(drawn).not_to_have_count(0)
    page.get_by_text("Corners in metres").click()
    expect(corners).to_have_count(3)


def test_what_has_the_name_of_a_rule_can_be_run_dry(plan: Plan, office: Office) -> None:
    page = plan.page
    ann = office.track("ann")
    office.see(ann, -5, -5, after_s=-300)
    office.see(ann, 3, 2, after_s=-290)
    page.locator("#tab-rules").click()
    page.get_by_role("button", name="Write a rule").click()
    page.get_by_label("The rule as YAML").fill(
        "name: room_visits\ninput: track_in_room\nemit: {began: came}\n"
    )
    expect(page.locator("#rule-verdict")).to_contain_text("room_visits")
    expect(page.get_by_role("button", name="Add and turn on")).to_be_disabled()
    expect(page.get_by_role("region", name="Dry run")).to_contain_text("It would have made 1 event.")


def test_names_stay_within_their_rooms(page: Page, served: Served) -> None:
    rooms = building((LONG, 0, 0, 8, 4), (ARABIC, 8, 0, 14, 4), ("Lift", 14, 0, 16, 4))
    page.add_init_script(f"({RECORD})()")
    page.goto(brought_in(served, "names_stay", rooms))
    page.wait_for_selector("#status[data-state=live]")
    until_written(page, "Lift")
    written: dict[str, dict[str, Any]] = page.evaluate("Object.fromEntries(window.written)")
    px_per_m = Plan.measured(page).px_per_m[0]
    for name, width_m, direction in ((LONG, 8, "ltr"), (ARABIC, 6, "rtl"), ("Lift", 2, "ltr")):
        (text,) = (each for each in written if name.startswith(each.removesuffix("…")))
        assert written[text]["width"] <= width_m * px_per_m
        assert written[text]["direction"] == direction
    for name in (LONG, ARABIC):
        page.locator("#tab-details").click()
        expect(page.locator("#panel-details").get_by_role("button", name=name)).to_be_visible()


def test_many_things_are_few_stops_before_the_timeline(page: Page, served: Served) -> None:
    rooms = building(*((f"room {n}", 4 * (n % 20), 4 * (n // 20), 4 * (n % 20) + 4, 4 * (n // 20) + 4)
                       for n in range(150)))  # fmt: skip
    page.goto(brought_in(served, "many_things", rooms))
    page.wait_for_selector("#status[data-state=live]")
    page.locator("#tab-details").click()
    expect(page.locator("#panel-details li")).to_have_count(150)
    page.locator("#panel-details li").first.get_by_role("button").focus()
    page.keyboard.press("ArrowDown")
    expect(page.locator("#panel-details li").nth(1).get_by_role("button")).to_be_focused()
    page.evaluate("document.activeElement.blur()")
    page.locator("a.skip").first.focus()
    for _ in range(MOST_TAB_STOPS):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.id") == "timeline":
            return
    pytest.fail(f"the timeline is more than {MOST_TAB_STOPS} stops away")
