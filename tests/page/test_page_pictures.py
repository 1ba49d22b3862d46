"""Pictures of the page's states to look at: pytest tests/page/test_page_pictures.py --screenshots DIR"""

from __future__ import annotations

import pytest
from measured import in_every_size, in_every_theme, take_picture
from playwright.sync_api import Page, expect
from served import Office


@in_every_size
@in_every_theme
def test_every_state(page: Page, office: Office, request: pytest.FixtureRequest) -> None:
    folder = request.config.getoption("--screenshots")
    if not folder:
        pytest.skip("pictures are made on demand: --screenshots DIR")

    def picture(name: str) -> None:
        take_picture(page, request, f"-{name}")

    people = [office.track(name) for name in ("ann", "bob", "cid")]
    for number, person in enumerate(people):
        for second in range(12):
            office.see(person, 1 + second * 0.8, 2 + number + second * 0.15, after_s=second - 20)
    office.happen("entered", people[0], "lab", after_s=-10)
    office.happen("left", people[1], "kitchen", after_s=-9)
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    for tab in ("details", "events", "queries", "import"):
        page.locator(f"#tab-{tab}").click()
        page.wait_for_load_state("networkidle")
        picture(tab)
    page.locator("#view-space").click()
    picture("space")
    page.locator("#view-plan").click()

    page.locator("#tab-details").click()
    page.locator("#panel-details").get_by_role("button", name="Kitchen", exact=True).click()
    page.locator("#tab-edit").click()
    expect(page.get_by_role("form", name="Edit kitchen")).to_be_visible()
    picture("edit")
    page.keyboard.press("m")
    expect(page.get_by_role("form", name="Move kitchen")).to_be_visible()
    picture("reshape")
    page.keyboard.press("Escape")
    box = page.locator("#stage").bounding_box()
    assert box is not None
    page.keyboard.press("r")
    for x, y in ((0.55, 0.1), (0.8, 0.1), (0.8, 0.35)):
        page.mouse.click(box["x"] + box["width"] * x, box["y"] + box["height"] * y)
    page.mouse.move(box["x"] + box["width"] * 0.55, box["y"] + box["height"] * 0.4)
    picture("drawing")
    page.keyboard.press("Escape")

    page.locator("#tab-rules").click()
    expect(page.get_by_role("list", name="Rules").get_by_role("listitem")).to_have_count(1)
    picture("rules")
    page.get_by_role("button", name="Write a rule").click()
    page.get_by_label("Tell me when …").select_option("opened_then_entered")
    expect(page.locator("#rule-verdict")).to_contain_text("Right.")
    picture("writing")
    text = page.get_by_label("The rule as YAML")
    text.fill("name: comings\ninput: track_in_room\nemit: {begun: came}\n")
    expect(page.locator("#rule-verdict")).to_contain_text("there is no such edge")
    picture("writing-wrong")
    text.fill("name: comings\ninput: track_in_room\nemit: {began: came}\n")
    expect(page.get_by_role("region", name="Dry run")).to_contain_text("It would have made")
    picture("dry-run")
    page.get_by_role("button", name="Back").click()
    expect(page.get_by_role("dialog")).to_be_visible()
    picture("question")
