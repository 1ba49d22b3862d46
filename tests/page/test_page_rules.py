"""A rule in the browser: wrong, right, tried on what is stored, in force, changed, explained, deleted."""

from __future__ import annotations

from plan import Plan
from playwright.sync_api import Page, expect
from served import Office

WRONG = "name: comings\ninput: track_in_room\nemit: {begun: came}\n"
RIGHT = WRONG.replace("begun", "began")
KITCHEN, LAB, OUTSIDE = (3.0, 2.0), (11.0, 2.0), (-5.0, -5.0)


def open_rules(page: Page) -> None:
    page.locator("#tab-rules").click()
    expect(page.get_by_role("list", name="Rules").get_by_role("listitem")).to_have_count(1)


def test_from_an_error_to_a_rule_in_force(plan: Plan, office: Office) -> None:
    page = plan.page
    ann = office.track("ann")
    for after_s, place in ((-300, OUTSIDE), (-290, KITCHEN), (-280, LAB), (-270, OUTSIDE)):
        office.see(ann, *place, after_s=after_s)
    open_rules(page)
    page.get_by_role("button", name="Write a rule").click()
    text = page.get_by_label("The rule as YAML")
    text.fill(WRONG)
    expect(page.locator("#rule-verdict")).to_contain_text("there is no such edge")
    expect(page.locator("#rule-verdict")).to_contain_text("line 3, column 15")
    expect(text).to_have_attribute("aria-invalid", "true")
    add = page.get_by_role("button", name="Add and turn on")
    expect(add).to_be_disabled()
    page.locator("#rule-verdict .place").click()
    assert text.evaluate("(area) => area.value.slice(area.selectionStart)") == "came}\n"

    text.fill(RIGHT)
    expect(page.locator("#rule-verdict")).to_have_text("Right. It makes came.")
    expect(page.get_by_role("region", name="Dry run")).to_contain_text("It would have made 2 events.")
    expect(page.get_by_role("region", name="Dry run").get_by_role("listitem")).to_have_count(2)
    assert office.get("/events", map=office.name)["events"] == [], "a dry run writes nothing"

    add.click()
    expect(page.get_by_text("The rule comings is on.")).to_be_visible()
    rules = office.get("/rules", map=office.name)["rules"]
    assert [(each["name"], each["enabled"]) for each in rules] == [("room_visits", True), ("comings", True)]
    assert rules[1]["declaration"] == {"input": "track_in_room", "emit": {"began": "came"}}


def test_change_turn_off_explain_and_delete(plan: Plan, office: Office) -> None:
    page = plan.page
    (rule,) = office.get("/rules", map=office.name)["rules"]
    open_rules(page)
    page.get_by_role("button", name="Edit room_visits").click()
    text = page.get_by_label("The rule as YAML")
    expect(text).to_have_value(
        "name: room_visits\ninput: track_in_room\nemit:\n  began: entered\n  ended: left\n"
    )
    text.fill(text.input_value().replace("entered", "came in"))
    expect(page.locator("#rule-verdict")).to_contain_text("emit.began")
    text.fill(text.input_value().replace("came in", "came_in"))
    page.get_by_role("button", name="Replace and turn on").click()
    expect(page.get_by_text("The rule room_visits is on.")).to_be_visible()
    changed = office.get(f"/rules/{rule['id']}")
    assert (changed["version"], changed["declaration"]["emit"]["began"]) == (rule["version"] + 1, "came_in")

    page.get_by_role("button", name="Turn off room_visits").click()
    expect(page.get_by_role("button", name="Turn on room_visits")).to_be_visible()
    assert not office.get(f"/rules/{rule['id']}")["enabled"]

    page.get_by_role("button", name="Explain room_visits").click()
    form = page.get_by_role("form", name="Explain room_visits")
    form.get_by_role("button", name="Explain").click()
    expect(form.locator("pre")).to_be_visible()

    page.get_by_role("button", name="Delete room_visits").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    expect(page.get_by_text("No rules on this map.")).to_be_visible()
    assert office.get("/rules", map=office.name)["rules"] == []


def test_a_query_is_added_turned_off_and_deleted(plan: Plan, office: Office, fails_requests: None) -> None:
    page = plan.page
    page.locator("#tab-queries").click()
    queries = page.get_by_role("list", name="Queries").get_by_role("listitem")
    expect(queries).to_have_count(1)
    page.get_by_text("Add a query").click()
    form = page.get_by_role("form", name="Add a query")
    form.get_by_label("Name").fill("track_at_table")
    form.get_by_label("Concept").select_option("Table")
    form.get_by_role("button", name="Add").click()
    expect(queries).to_have_count(2)
    page.get_by_role("button", name="Turn off track_at_table").click()
    expect(page.get_by_role("button", name="Turn on track_at_table")).to_be_visible()
    made = office.get("/queries", map=office.name)["queries"][1]
    assert (made["name"], made["concept"], made["enabled"]) == ("track_at_table", "Table", False)
    page.get_by_role("button", name="Delete track_in_room").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    expect(queries.filter(has_text="track_in_room").get_by_role("alert")).to_be_visible()
    page.get_by_role("button", name="Delete track_at_table").click()
    page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    expect(queries).to_have_count(1)
