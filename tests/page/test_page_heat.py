"""The rooms in the colours of the hours that people spent there, over a day or a week."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import pytest
from measured import flaws, in_every_size, in_every_theme, is_touched
from plan import Plan
from playwright.sync_api import Page, expect
from served import Office

KITCHEN, LAB, OUTSIDE = (3.0, 2.0), (11.0, 2.0), (-5.0, -5.0)
HOUR_S = 3600


@pytest.fixture
def week(office: Office) -> Office:
    """Ann was in the kitchen for two hours and in the lab for half of one; four days before, for six in the lab."""
    office.now = datetime(2026, 1, 9, 9, tzinfo=UTC)
    ann = office.track("ann")
    before_s = -timedelta(days=4).total_seconds()
    for after_s, place in (
        (before_s, LAB),
        (before_s + 6 * HOUR_S, OUTSIDE),
        (0, KITCHEN),
        (2 * HOUR_S, LAB),
        (2.5 * HOUR_S, OUTSIDE),
    ):
        office.see(ann, *place, after_s=after_s)
    return office


def hours(office: Office, room: str, days: int) -> float:
    """As the service tells them of the days that end with the ninth of January."""
    end = datetime(2026, 1, 10, tzinfo=UTC)
    asked = {"from": (end - timedelta(days=days)).isoformat(), "to": end.isoformat(), "each": "day"}
    found: float = office.get(f"/rooms/{office.instance(room)['id']}/occupancy", **asked)["total_s"] / HOUR_S
    return found


@in_every_theme
@in_every_size
def test_rooms_have_the_colours_of_their_hours(page: Page, week: Office) -> None:
    page.add_init_script("localStorage.setItem('semap.zone', 'utc')")
    page.goto(week.page)
    page.wait_for_selector("#status[data-state=live]")
    plan = Plan.measured(page) if not is_touched(page) else None
    legend = page.locator(".legend")
    legend.locator("summary").click()
    page.get_by_label("Colours of the rooms").select_option("hours of the day")
    expect(legend.locator("summary")).to_contain_text("Hours that people spent there")
    expect(legend.locator(".swatches i").last).to_have_text(f"{hours(week, 'kitchen', 1):.1f}")
    if plan:
        legend.locator("summary").click()
        plan.finds(*KITCHEN, f"{hours(week, 'kitchen', 1):.1f} h")
        plan.finds(*LAB, f"{hours(week, 'lab', 1):.1f} h")
        legend.locator("summary").click()
    page.get_by_label("Colours of the rooms").select_option("hours of the week")
    expect(legend.locator(".swatches i").last).to_have_text(f"{hours(week, 'lab', 7):.1f}")
    assert flaws(page) == []
    page.reload()
    expect(page.locator(".legend .swatches i").last).to_have_text(f"{hours(week, 'lab', 7):.1f}")
