"""The first minute: a service without maps offers to draw one, to bring one in, or a sample; a tour; and more than one way out."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import httpx
import pytest
from measured import in_every_size, in_every_theme
from playwright.sync_api import Page, expect
from served import Served
from server import database_with_slot

from semap.cluster import Cluster
from semap.store.database.connection import connect


@pytest.fixture
def empty(cluster: Cluster, template: str) -> Iterator[Served]:
    """A service over a database without maps."""
    with database_with_slot(cluster, template) as dsn:
        running = Served(dsn)
        try:
            yield running.start()
        finally:
            running.stop()
            with connect(dsn) as connection:
                connection.execute("select pg_drop_replication_slot(semap.rule_slot())")


def test_a_building_is_drawn_on_an_empty_service(empty: Served, page: Page) -> None:
    page.goto(f"{empty.url}/")
    page.get_by_label("Name of the building").fill("My house")
    page.get_by_role("button", name="Draw it").click()
    expect(page.get_by_role("button", name="Draw a room").first).to_be_visible()
    expect(page.locator("#panel-edit")).to_be_visible()
    assert [each["name"] for each in httpx.get(f"{empty.url}/maps").json()["maps"]] == ["My house"]


def test_the_sample_is_played_as_if_it_happened_now(empty: Served, page: Page) -> None:
    page.goto(f"{empty.url}/")
    page.get_by_role("button", name="Play the sample").click()
    expect(page.locator("#status")).to_have_attribute("data-state", "live")
    page.locator("#tab-details").click()
    for name in ("ann", "bob", "eve"):
        expect(page.locator("#panel-details").get_by_role("button", name=name, exact=True)).to_be_visible()
    page.locator("#sample").get_by_role("button", name="Stop").click()
    expect(page.locator("#sample")).to_have_count(0)
    # everybody has left
    expect(page.locator("#panel-details").get_by_role("button", name="ann", exact=True)).to_have_count(0)
    tracks = httpx.get(f"{empty.url}/tracks", params={"map": "sample"}).json()["tracks"]
    assert sorted(each["name"] for each in tracks) == ["ann", "bob", "eve"]
    doors = httpx.get(f"{empty.url}/doors", params={"map": "sample"}).json()["doors"]
    assert {each["state"]["value"] for each in doors} <= {"open", "closed"}


def test_a_tour_of_five_steps_can_be_left(empty: Served, page: Page) -> None:
    page.goto(f"{empty.url}/")
    page.get_by_role("button", name="Take the tour").click()
    tour = page.get_by_role("dialog", name="Tour")
    titles = []
    for i in range(1, 6):
        expect(tour).to_contain_text(f"{i} of 5")
        titles.append(tour.get_by_role("heading").inner_text())
        tour.get_by_role("button", name="Done" if i == 5 else "Next").click()
    assert len(set(titles)) == 5
    expect(tour).to_have_count(0)
    page.locator("body").press("?")
    page.get_by_role("dialog", name="Keys").get_by_role("button", name="Take the tour").click()
    tour.get_by_role("button", name="Next").click()
    tour.get_by_role("button", name="Back").click()
    expect(tour).to_contain_text("1 of 5")
    page.locator("body").press("Escape")
    expect(tour).to_have_count(0)


@in_every_theme
@in_every_size
def test_the_first_minute_is_accessible_and_fits(
    page: Page, empty: Served, look: Callable[[str], list[str]]
) -> None:
    page.goto(f"{empty.url}/")
    expect(page.get_by_role("button", name="Play the sample")).to_be_visible()
    assert look("welcome") == []
    page.get_by_role("button", name="Take the tour").click()
    page.get_by_role("button", name="Next").click()
    assert look("tour") == []
