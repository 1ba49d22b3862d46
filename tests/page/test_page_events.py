"""What has happened, found among ten thousand events by words, type, person, place and day; by mouse, keys and finger."""

from __future__ import annotations

import csv
from datetime import UTC, datetime
from pathlib import Path

import pytest
from measured import flaws, in_every_size, in_every_theme
from playwright.sync_api import Page, expect
from served import Office

MANY = 10_000
FIRST = datetime(2026, 1, 1, tzinfo=UTC)
LAST = "2026-01-07T22:39:00Z"


@pytest.fixture
def busy(office: Office) -> Office:
    """An event a minute for a week, of ten people in turn who enter or leave a room; one of another kind, long ago."""
    office.now = FIRST
    people = [office.track(name) for name in ("Bob", "Ann", *(f"P{i}" for i in range(8)))]
    office.plain.execute(
        "with last as (select coalesce(max(seq), 0) as seq from semap.event)"
        " insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, since, cause, track_id, track_name,"
        " instance_id, instance_name, measures)"
        " select last.seq + n, gen_random_uuid(), t.map_id, 'visits', 1, case when n = 777 then 'fell' when n %% 2 = 0 then 'left'"
        " else 'entered' end, at, at, 'moved', t.track_id, t.name, i.instance_id, i.name, '{}'"
        " from last, generate_series(1, %s) n, lateral (select %s + n * interval '1 minute' as at) a,"
        " semap.track t, semap.instance i where t.track_id = (%s::bigint[])[n %% 10 + 1] and i.map_id = t.map_id"
        " and i.name = case when n %% 100 < 50 then 'kitchen' else 'hallway' end order by n",
        [MANY, FIRST, people],
    )
    return office


def opened(page: Page, office: Office) -> None:
    page.goto(f"{office.page}&at={LAST}&panels=open")
    expect(page.locator("#event-list").get_by_role("button").first).to_contain_text("Bob left Kitchen")


def test_any_of_ten_thousand_is_found_by_words(page: Page, busy: Office) -> None:
    opened(page, busy)
    page.locator("body").press("/")
    expect(page.get_by_label("Find events")).to_be_focused()
    page.keyboard.type("fell P5")
    found = page.locator("#event-list").get_by_role("button")
    expect(found).to_have_count(1)
    expect(found).to_contain_text("12:57:00")
    found.click()
    expect(page.locator("#panel-details")).to_contain_text("Fell")
    expect(page.locator("#status")).to_contain_text("12:57:00")
    page.reload()
    page.locator("#tab-events").click()
    expect(found).to_have_count(1)
    page.get_by_role("button", name="Show all events").click()
    expect(found.first).to_contain_text("Bob left")
    page.get_by_label("Find events").fill("nothing of the kind")
    expect(page.locator("#panel-events")).to_contain_text("Nothing like that has happened.")


def test_by_type_person_place_and_day_and_saved_whole(page: Page, busy: Office) -> None:
    opened(page, busy)
    filters = page.get_by_role("search", name="Events")
    filters.locator("summary").click()
    filters.get_by_label("Day").fill("2026-01-02")
    filters.get_by_label("What").select_option("entered")
    filters.get_by_label("Where").select_option(label="Kitchen")
    filters.get_by_label("Who").fill("Ann")
    filters.get_by_label("Who").press("Enter")
    asked = {
        "from": "2026-01-02T00:00:00Z",
        "to": "2026-01-02T23:59:59.999Z",
        "type": "entered",
        "instance": "kitchen",
        "track": "Ann",
    }
    told = busy.get(f"/maps/{busy.name}/events", limit=1000, **asked)
    assert len(told["events"]) > 50
    first = page.locator("#event-list li").first
    expect(first).to_have_attribute("aria-setsize", str(len(told["events"])))
    expect(first).to_contain_text("Ann entered Kitchen")
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save as CSV").click()
    rows = list(csv.DictReader(Path(saved.value.path()).read_text(encoding="utf-8").splitlines()))
    assert [row["event_id"] for row in rows] == [each["event_id"] for each in told["events"]]
    assert rows[0]["what"] == "Ann entered Kitchen"
    busy.happen(
        "entered",
        busy.plain.execute(
            "select track_id from semap.track join semap.map using (map_id) where semap.map.name = %s and semap.track.name = 'Ann'",
            [busy.name],
        ).fetchone()[0],
        "kitchen",
        after_s=86_400 * 2 - 1,
    )
    expect(first).to_have_attribute("aria-setsize", str(len(told["events"]) + 1))  # as it comes, too


def test_the_list_goes_back_as_far_as_one_scrolls_and_keeps_few_rows(page: Page, busy: Office) -> None:
    opened(page, busy)
    rows = page.locator("#event-list li")
    stops = "() => [...document.querySelectorAll('#event-list button')].filter((each) => each.tabIndex === 0).length"
    page.locator("#event-list button").first.focus()
    seen = 0
    for _ in range(12):  # pages of 200
        page.keyboard.press("End")
        expect(rows.last).not_to_have_attribute("aria-posinset", str(seen))
        seen = int(rows.last.get_attribute("aria-posinset") or 0)
        assert rows.count() < 60
        assert page.evaluate(stops) == 1
    assert seen > 1000
    at = page.evaluate("() => Number(document.activeElement.closest('li').dataset.at)")
    page.keyboard.press("ArrowUp")
    expect(page.locator(f'#event-list li[data-at="{at - 1}"] button')).to_be_focused()
    page.keyboard.press("PageUp")
    page.keyboard.press("Home")
    expect(rows.first.get_by_role("button")).to_be_focused()
    expect(rows.first).to_have_attribute("aria-posinset", "1")
    stamps = page.locator("#event-list time").evaluate_all("all => all.map((each) => each.dateTime)")
    assert stamps == sorted(stamps, reverse=True)


def test_what_is_in_sight_stays_when_more_happens(page: Page, busy: Office) -> None:
    opened(page, busy)
    page.locator(".virtual").evaluate("(list) => list.scrollTo(0, 2000)")
    seen = "(list) => [...list.querySelectorAll('li')].find((each) => each.getBoundingClientRect().top >= list.getBoundingClientRect().top)"
    expect(page.locator("#event-list li").first).to_have_attribute("aria-posinset", "29")
    before = page.locator(".virtual").evaluate(f"(list) => ({seen})(list).textContent")
    track = busy.track("Eve")
    for i in range(3):
        busy.happen("entered", track, "kitchen", after_s=(MANY + i) * 60)
    expect(page.locator("#event-list li").first).to_have_attribute("aria-posinset", "32")
    assert page.locator(".virtual").evaluate(f"(list) => ({seen})(list).textContent") == before
    page.locator(".virtual").evaluate("(list) => list.scrollTo(0, 0)")
    expect(page.locator("#event-list li").first).to_contain_text("Eve entered Kitchen")


def test_what_is_found_on_the_map_tells_what_happened(page: Page, busy: Office) -> None:
    opened(page, busy)
    page.locator("#tab-details").click()
    page.locator("body").press("/")
    expect(page.get_by_label("Find on the map")).to_be_focused()
    page.keyboard.type("ann kitchen")
    panel = page.locator("#panel-details")
    expect(panel.get_by_role("button", name="Ann", exact=False).first).to_contain_text("Kitchen")
    panel.get_by_role("button", name="All of these events").click()
    expect(page.get_by_label("Find events")).to_have_value("ann kitchen")
    expect(page.locator("#event-list li").first).to_contain_text("Ann")


@in_every_theme
@in_every_size
def test_the_list_is_accessible_and_fits(page: Page, busy: Office) -> None:
    opened(page, busy)
    page.get_by_role("search", name="Events").locator("summary").click()
    page.get_by_label("Find events").fill("ann")
    expect(page.locator("#event-list li").first).to_contain_text("Ann")
    assert flaws(page) == []
