"""A room's use over a day and a month: how many, when most, how long, who; the same as the service's numbers."""

from __future__ import annotations

import csv
from datetime import UTC, datetime
from pathlib import Path

import pytest
from measured import flaws, in_every_size, in_every_theme
from playwright.sync_api import Page, expect
from served import Office

KITCHEN, OUTSIDE = (3.0, 2.0), (-20.0, 2.0)
NINE = datetime(2026, 1, 5, 9, tzinfo=UTC)
H_S = 3600


@pytest.fixture
def kitchen(office: Office) -> None:
    """Bob from 9:00 to 10:30 and from 12:00 to 12:15, Ann from 10:00 to 11:00; Ann again on the next day for an hour."""
    office.now = NINE
    bob, ann = office.track("Bob"), office.track("Ann")
    for who, begin_h, end_h in ((bob, 0, 1.5), (ann, 1, 2), (bob, 3, 3.25), (ann, 24, 25)):
        office.see(who, *KITCHEN, after_s=begin_h * H_S)
        office.see(who, *OUTSIDE, after_s=end_h * H_S)


def opened(page: Page, office: Office) -> None:
    page.goto(f"{office.page}&at=2026-01-05T12:05:00Z")
    expect(page.locator("#status")).to_contain_text("12:05:00")
    if page.locator("#panel-details").is_hidden():
        page.locator("#tab-details").click()
    page.get_by_label("Find on the map").fill("kitchen")
    page.locator("#panel-details").get_by_role("button", name="Kitchen").first.click()


def test_a_day_and_a_month_of_a_room(page: Page, office: Office, kitchen: None) -> None:
    opened(page, office)
    use = page.get_by_role("region", name="Use")
    expect(use).to_contain_text("2 from 2026-01-05 10:00:00")
    room = office.instance("Kitchen")
    asked = {"from": "2026-01-05T00:00:00Z", "to": "2026-01-06T00:00:00Z"}
    told = office.get(f"/rooms/{room['id']}/occupancy", **asked)
    assert (told["stays"], told["tracks"], told["total_s"]) == (3, 2, 2.75 * H_S)
    expect(use).to_contain_text("On average0.11")
    expect(use).to_contain_text("3, half of them up to 1 h 00 min, the longest 1 h 30 min")
    who = page.get_by_role("region", name="Who was in it").get_by_role("listitem")
    expect(who).to_have_text(["Bob1 h 45 min, 2 times", "Ann1 h 00 min"])
    use.get_by_text("Hour by hour").click()
    expect(use.locator(".bars").get_by_role("row")).to_have_text(
        ["FromAverageMostPeople", "09:001.0011", "10:001.5022", "12:000.2511"]
    )
    with page.expect_download() as saved:
        use.get_by_role("button", name="Save as CSV").click()
    assert saved.value.suggested_filename == "kitchen_2026-01-05.csv"
    rows = list(csv.DictReader(Path(saved.value.path()).read_text(encoding="utf-8").splitlines()))
    assert [(row["mean"], row["peak"]) for row in rows] == [
        (f"{span['mean']:.4f}", str(span["peak"])) for span in told["spans"]
    ]
    assert rows[10]["since"].startswith("2026-01-05T10:00:00")

    use.locator(".columns").scroll_into_view_if_needed()
    box = use.locator(".columns").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 10.5 / 24 * box["width"], box["y"] + 30)
    expect(page.locator("#status")).to_contain_text("10:00:00")

    use.get_by_role("button", name="Month").click()
    expect(use).to_contain_text("Day by day")
    expect(who).to_have_text(["Ann2 h 00 min, 2 times", "Bob1 h 45 min, 2 times"])
    use.get_by_role("button", name="Day", exact=True).click()
    use.get_by_role("button", name="The day before").click()
    expect(use).to_contain_text("Nobody was in it.")


@in_every_theme
@in_every_size
def test_the_card_is_accessible_and_fits(page: Page, office: Office, kitchen: None) -> None:
    opened(page, office)
    use = page.get_by_role("region", name="Use")
    expect(use).to_contain_text("2 from 2026-01-05 10:00:00")
    use.get_by_text("Hour by hour").click()
    use.scroll_into_view_if_needed()
    assert flaws(page) == []
