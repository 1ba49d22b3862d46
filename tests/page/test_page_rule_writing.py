"""Writing rules in the browser: as a sentence, with names that are completed, drawn, and tried as one types."""

from __future__ import annotations

import json
import re
from collections.abc import Callable

import pytest
from measured import in_every_size, in_every_theme
from playwright.sync_api import Locator, Page, Route, expect
from served import Office

KITCHEN, LAB, OUTSIDE = (3.0, 2.0), (11.0, 2.0), (-5.0, -5.0)
BOTH = "name: comings\ninput: track_in_room\nemit: {began: came, ended: went}\n"
TOLD = """
    window.Notification = class {
        static permission = "default";
        static requestPermission() { return Promise.resolve(this.permission = "granted"); }
        constructor(title, options) {
            const {dataset} = document.documentElement;
            dataset.told = (dataset.told ?? "") + `${title} (${options.body}).`;
        }
    };
"""


@pytest.fixture
def visited(office: Office) -> Office:
    """Ann was in the kitchen for a minute, and in the lab for ten seconds."""
    ann = office.track("Ann")
    for after_s, place in ((-300, OUTSIDE), (-290, KITCHEN), (-230, LAB), (-220, OUTSIDE)):
        office.see(ann, *place, after_s=after_s)
    return office


def begin(page: Page, office: Office) -> None:
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    page.locator("#tab-rules").click()
    page.get_by_role("button", name="Write a rule").click()


def text_of(page: Page) -> Locator:
    return page.get_by_label("The rule as YAML")


def sentence_of(page: Page) -> Locator:
    return page.get_by_role("region", name="The rule as a sentence")


def dry_run_of(page: Page) -> Locator:
    return page.get_by_role("region", name="Dry run")


def test_a_dwell_alert_by_somebody_who_has_never_seen_yaml(page: Page, visited: Office) -> None:
    page.add_init_script(TOLD)
    begin(page, visited)
    page.get_by_label("Tell me when …").select_option("Somebody stays long")
    sentence = sentence_of(page)
    sentence.get_by_label("Room", exact=True).select_option("kitchen")
    sentence.get_by_label("Duration", exact=True).fill("30")
    sentence.get_by_label("Unit of duration").select_option("seconds")
    expect(page.locator("#rule-verdict")).to_have_text("Right. It makes dwelt.")
    expect(dry_run_of(page)).to_contain_text("It would have made 1 event.")
    expect(dry_run_of(page).get_by_role("listitem")).to_contain_text("Ann dwelt in")
    expect(page.locator(".time-tools .found")).to_contain_text("dwelt (1)")
    sentence.get_by_label("Duration", exact=True).fill("90")
    expect(dry_run_of(page)).to_contain_text("It would have made no event.")
    notify = page.get_by_role("button", name="Notify me in this browser")
    notify.click()
    expect(notify).to_have_attribute("aria-pressed", "true")
    page.get_by_role("button", name="Add and turn on").click()
    expect(page.get_by_text("The rule dwelt is on.")).to_be_visible()
    made = visited.get("/rules", map=visited.name)["rules"][1]
    assert (made["name"], made["declaration"]["within"]) == ("dwelt", "90 s")
    assert made["declaration"]["where"] == "instance = 'kitchen'"

    bob = visited.track("Bob")
    visited.happen("entered", bob, "kitchen", after_s=0)
    visited.happen("dwelt", bob, "kitchen", after_s=1)
    told = re.compile(rf"^Bob dwelt in [^.]*\({visited.name}, [^)]*\)\.$")
    expect(page.locator("html")).to_have_attribute("data-told", told)
    page.get_by_role("button", name="Notify me of dwelt").click()
    visited.happen("dwelt", bob, "kitchen", after_s=2)
    visited.happen("entered", bob, "kitchen", after_s=3)
    page.locator("#tab-events").click()
    expect(page.locator("#event-list").get_by_role("button")).to_have_count(4)
    expect(page.locator("html")).to_have_attribute("data-told", told)


def test_a_browser_that_shows_no_notifications_says_so(page: Page, visited: Office) -> None:
    page.add_init_script(TOLD.replace('this.permission = "granted"', 'this.permission = "denied"'))
    begin(page, visited)
    text_of(page).fill(BOTH)
    notify = page.get_by_role("button", name="Notify me in this browser")
    notify.click()
    expect(page.get_by_role("alert")).to_contain_text("Allow them in the settings of the site")
    expect(notify).to_have_attribute("aria-pressed", "false")


def test_a_sentence_and_its_text_say_the_same_both_ways(
    page: Page, visited: Office, fails_requests: None
) -> None:
    begin(page, visited)
    text, sentence = text_of(page), sentence_of(page)
    page.get_by_label("Tell me when …").select_option("Nobody is in a room for long")
    sentence.get_by_label("Room", exact=True).select_option("lab")
    expect(text).to_have_value(re_of("where: \"instance = 'lab'\"", "within: 30 min"))
    text.fill(text.input_value().replace("30 min", "2 h").replace("'lab'", "'kitchen'"))
    expect(sentence.get_by_label("Duration", exact=True)).to_have_value("2")
    expect(sentence.get_by_label("Unit of duration")).to_have_value("h")
    expect(sentence.get_by_label("Room", exact=True)).to_have_value("kitchen")
    text.fill(text.input_value().replace("occupants = 0", "occupants < 2"))
    expect(page.locator("#unsaid")).to_contain_text("“Nobody is in a room for long”, has another define.")
    expect(sentence.locator(".phrase")).to_have_count(0)
    text.fill("name: [")
    expect(sentence).to_contain_text("as soon as the text is right")
    text.fill(BOTH)
    expect(page.get_by_label("Tell me when …")).to_have_value("visits")
    expect(sentence.get_by_label("Person", exact=True)).to_have_value("")
    sentence.get_by_label("Person", exact=True).select_option("Ann")
    expect(text).to_have_value(re_of("where: \"track = 'Ann'\"", "began: came"))
    sentence.get_by_text("More about it").click()
    sentence.get_by_label("name of the rule", exact=True).fill("two words")
    expect(sentence.get_by_role("alert")).to_contain_text("a name is needed")


def re_of(*parts: str) -> re.Pattern[str]:
    """A pattern of a text that has these parts in this order."""
    return re.compile(".*".join(map(re.escape, parts)), re.DOTALL)


def test_names_are_completed_as_one_types(page: Page, visited: Office) -> None:
    begin(page, visited)
    text = text_of(page)
    options = page.get_by_role("listbox", name="Completions").get_by_role("option")
    text.press_sequentially("name: a\ninp")
    expect(options).to_have_count(1)
    expect(text).to_have_attribute("aria-activedescendant", "rule-completions-0")
    text.press("Enter")
    text.press_sequentially("tra")
    expect(options).to_contain_text("track_in_room")
    text.press("Enter")
    text.press("Enter")
    text.press_sequentially("where: inst")
    text.press("ArrowDown")
    expect(options.nth(1)).to_have_attribute("aria-selected", "true")
    text.press("ArrowUp")
    text.press("Enter")
    text.press_sequentially(" = '")
    options.get_by_text("kitchen", exact=True).click()
    expect(text).to_be_focused()
    text.press_sequentially(" and concept = 'Roo")
    text.press("Enter")
    text.press("Enter")
    text.press_sequentially("emit: {began: b}")
    expect(text).to_have_value(
        "name: a\ninput: track_in_room\nwhere: instance = 'kitchen' and concept = 'Room'\nemit: {began: b}"
    )
    expect(page.locator("#rule-verdict")).to_have_text("Right. It makes b.")
    text.press("Control+ ")
    text.press_sequentially("\npar")
    expect(options).to_have_count(1)
    text.press("Escape")
    expect(options).to_have_count(0)
    expect(text).to_be_focused()


def test_a_pattern_is_drawn_as_the_service_reads_it(page: Page, visited: Office) -> None:
    begin(page, visited)
    page.get_by_label("Tell me when …").select_option("Somebody opens a door and goes in")
    drawing = page.get_by_role("img", name="The pattern")
    expect(drawing.locator(".sign")).to_have_text(["O", "E", "!"])
    expect(drawing.locator(".arrow text").first).to_have_text("later")
    text = text_of(page)
    text.fill(text.input_value().replace("O followed by E", "O followed by (E | E+)"))
    expect(drawing.locator(".group")).to_have_count(2)
    page.get_by_label("Tell me when …").select_option("Somebody stays long")
    expect(drawing.locator(".never")).to_have_count(1)
    text.fill("name: [")
    expect(drawing).to_have_count(0)


def test_only_the_newest_text_is_tried(page: Page, visited: Office) -> None:
    """The answer to an older text that comes late is not taken for that of the newer one."""
    begin(page, visited)
    held: list[Route] = []
    types: list[list[str]] = []

    def hold(route: Route) -> None:
        asked = json.loads(route.request.post_data or "{}")
        types.append(sorted(asked["declaration"]["emit"].values()))
        if len(types) == 1:
            held.append(route)
        else:
            route.continue_()

    page.route("**/rules/dry-run", hold)
    cancelled: list[str] = []
    page.on("requestfailed", lambda request: cancelled.append(request.url))
    with page.expect_request("**/rules/dry-run"):
        text_of(page).fill(BOTH)
    expect(dry_run_of(page)).to_contain_text("Running…")
    text_of(page).fill(BOTH.replace(", ended: went", ""))
    expect(dry_run_of(page)).to_contain_text("It would have made 2 events.")
    assert types == [["came", "went"], ["came"]]
    assert [url for url in cancelled if url.endswith("dry-run")] == cancelled[-1:]
    text_of(page).fill(BOTH.replace("began", "begun"))
    expect(page.locator(".marks b")).to_contain_text("there is no such edge")
    expect(page.locator(".time-tools .found")).to_have_count(0)


@in_every_theme
@in_every_size
def test_everybody_can_write_rules(page: Page, visited: Office, look: Callable[[str], list[str]]) -> None:
    begin(page, visited)
    text = text_of(page)
    page.get_by_label("Tell me when …").select_option("Somebody stays long")
    page.get_by_label("Duration", exact=True).fill("30")
    page.get_by_label("Unit of duration").select_option("seconds")
    expect(dry_run_of(page)).to_contain_text("It would have made 1 event.")
    assert look("sentence") == []
    page.get_by_role("img", name="The pattern").scroll_into_view_if_needed()
    assert look("drawing") == []
    page.get_by_text("Add and turn on").scroll_into_view_if_needed()
    assert look("end") == []
    text.fill(
        "name: a\ninput: track_in_room\nwhere: \"instance = 'kitchen' and type = \"\nemit: {begun: b}\n"
    )
    expect(page.locator(".marks b")).to_have_count(1)
    text.evaluate("(area) => area.setSelectionRange(...Array(2).fill(area.value.indexOf('type = ') + 7))")
    text.press_sequentially("'")
    expect(page.get_by_role("listbox", name="Completions")).to_be_visible()
    assert look("completing") == []


def test_a_sentence_that_is_chosen_at_once_stays_chosen(page: Page, visited: Office) -> None:
    """What is said of the empty text comes when the sentence is chosen and its text is not there yet."""
    held: list[Route] = []
    page.route("**/rule-templates/*/text", lambda route: held.append(route))  # noqa: PLW0108
    begin(page, visited)
    with page.expect_response("**/rules/check"), page.expect_request("**/rule-templates/dwell/text"):
        page.get_by_label("Tell me when …").select_option("Somebody stays long")
    expect(page.get_by_label("Duration", exact=True)).to_have_value("10")
    held[0].continue_()
    expect(text_of(page)).to_have_value(re_of("name: dwelt", "within: 10 min"))
    expect(page.locator("#rule-verdict")).to_have_text("Right. It makes dwelt.")
