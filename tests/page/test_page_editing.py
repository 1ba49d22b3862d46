"""Editing in the browser: what is drawn is on the map, can be taken back, and overwrites nobody."""

from __future__ import annotations

import httpx
import pytest
import shapely
from plan import Plan
from playwright.sync_api import Locator, Page, Route, expect
from served import Office


def draw(plan: Plan, corners: list[tuple[float, float]]) -> None:
    plan.page.keyboard.press("r")
    for corner in [*corners, corners[0]]:
        plan.click(*corner)


def test_draw_a_room_and_take_it_back(plan: Plan, office: Office) -> None:
    page = plan.page
    before = office.names()
    draw(plan, [(6, 6.4), (8, 6.4), (8, 9), (6, 9)])
    form = page.get_by_role("form", name="New room")
    form.get_by_label("Name").fill("booth")
    form.get_by_role("button", name="Make the room").click()
    expect(page.get_by_role("form", name="Edit booth")).to_be_visible()
    made = office.instance("booth")
    drawn = shapely.box(6, 6.4, 8, 9)
    assert shapely.geometry.shape(made["footprint"]).symmetric_difference(drawn).area < 0.2
    assert (made["concept"], made["storey"]) == ("Room", "ground_floor")
    assert made["band"] == {"z_min_m": 0.0, "z_max_m": 2.7}

    undo = page.get_by_role("button", name="Undo: make the Room booth")
    expect(undo).to_be_enabled()
    page.locator("#stage").focus()
    page.keyboard.press("Control+z")
    expect(page.get_by_text("Undone: make the Room booth.")).to_be_visible()
    assert office.names() == before
    page.keyboard.press("Control+Shift+z")
    expect(page.get_by_text("Done again: make the Room booth.")).to_be_visible()
    assert office.names() == before | {"booth"}
    changes = office.get(f"/maps/{office.name}/changes")["changes"]
    assert [each["undoes"] for each in changes[:3]] == [changes[1]["id"], changes[2]["id"], None]
    assert len({each["author"] for each in changes[:3]}) == 1


@pytest.mark.parametrize("way", ["undo", "delete"])
def test_what_is_taken_away_is_not_read_meanwhile(plan: Plan, office: Office, way: str) -> None:
    page = plan.page
    draw(plan, [(6, 6.4), (8, 6.4), (8, 9), (6, 9)])
    page.get_by_role("button", name="Make the room").click()
    form = page.get_by_role("form", name="Edit Room 1")
    expect(form).to_be_visible()
    expect(page.get_by_role("button", name="Undo: make the Room Room 1")).to_be_enabled()
    address = f"/instances/{office.instance('Room 1')['id']}"
    # Never answered: an answer would come after the room is gone.
    page.route(f"**{address}", lambda route: None if route.request.method == "GET" else route.continue_())
    with page.expect_request(f"**{address}"):
        others = office.instance("lab")["id"]
        assert httpx.patch(f"{office.url}/instances/{others}", json={"alias": "Theirs"}).is_success
    with page.expect_event("requestfailed", lambda request: request.url.endswith(address)):
        if way == "undo":
            page.locator("#stage").focus()
            page.keyboard.press("Control+z")
        else:
            form.get_by_role("button", name="Delete").click()
            page.get_by_role("dialog").get_by_role("button", name="Delete").click()
    said = "Undone: make the Room Room 1." if way == "undo" else "Room 1 is deleted."
    expect(page.get_by_text(said)).to_be_visible()
    assert "Room 1" not in office.names()


def test_corners_keep_to_what_is_there(plan: Plan, office: Office) -> None:
    draw(plan, [(14.08, 0.07), (16, 0.05), (16, 3.93), (14.07, 4.08)])
    plan.page.get_by_role("button", name="Make the room").click()
    expect(plan.page.get_by_role("form", name="Edit Room 1")).to_be_visible()
    shape = shapely.geometry.shape(office.instance("Room 1")["footprint"])
    lab = shapely.geometry.shape(office.instance("lab")["footprint"])
    assert shape.intersection(lab).length == pytest.approx(4), "it shares the wall of the lab"
    assert shape.intersection(lab).area == 0


def test_what_crosses_itself_cannot_be_made(plan: Plan) -> None:
    page = plan.page
    draw(plan, [(1, 1), (5, 3), (5, 1), (1, 3)])
    expect(page.get_by_role("status").filter(has_text="Its sides cross.")).to_be_visible()
    expect(page.get_by_role("button", name="Make the room")).to_be_disabled()
    page.get_by_text("Corners in metres").click()
    for index, (x, y) in enumerate([(1, 1), (5, 1), (5, 3), (1, 3)], 1):
        page.get_by_label(f"x of corner {index}", exact=True).fill(str(x))
        page.get_by_label(f"y of corner {index}", exact=True).fill(str(y))
    page.get_by_role("button", name="Close the outline").click()
    expect(page.get_by_text("An area of 8.0 m²")).to_be_visible()


def test_draw_a_door_between_two_rooms(plan: Plan, office: Office) -> None:
    plan.page.keyboard.press("o")
    plan.click(9.05, 7.5)
    expect(plan.page.get_by_text("A door between office_2 and meeting_room")).to_be_visible()
    plan.page.get_by_role("button", name="Make the door").click()
    expect(plan.page.get_by_role("form", name="Edit Door 1")).to_be_visible()
    made = office.instance("Door 1")
    assert {each["name"] for each in made["joins"]} == {"office_2", "meeting_room"}
    assert (made["pose"]["x_m"], made["attributes"]) == (9.0, {"width_m": 0.9, "leaf": "left"})
    assert made["pose"]["y_m"] == pytest.approx(7.5, abs=0.1)


def test_move_and_reshape(plan: Plan, office: Office) -> None:
    page = plan.page
    kitchen = office.instance("kitchen")
    plan.click(3, 2)
    page.locator("#tab-edit").click()
    expect(page.get_by_role("form", name="Edit kitchen")).to_be_visible()
    page.keyboard.press("m")
    expect(page.get_by_role("form", name="Move kitchen")).to_be_visible()
    plan.drag((3, 2), (2, 2))
    plan.drag((5, 4), (5.5, 5))
    page.get_by_role("button", name="Put it there").click()
    expect(page.get_by_text("kitchen has its new place.")).to_be_visible()
    ring = office.instance("kitchen")["footprint"]["coordinates"][0]
    assert ring != kitchen["footprint"]["coordinates"][0]
    corners = {(round(x, 1), round(y, 1)) for x, y in ring}
    assert {(-1.0, 0.0), (5.0, 0.0), (-1.0, 4.0)} < corners
    assert office.instance("kitchen")["pose"]["x_m"] == pytest.approx(-1, abs=0.1)


def open_form(plan: Plan, x_m: float, y_m: float, name: str) -> Locator:
    plan.click(x_m, y_m)
    plan.page.locator("#tab-edit").click()
    form = plan.page.get_by_role("form", name=f"Edit {name}")
    expect(form).to_be_visible()
    return form


def test_who_is_faster_is_not_overwritten(plan: Plan, office: Office, fails_requests: None) -> None:
    """Between the last look and the change somebody else changes it: If-Match tells."""
    lab = office.instance("lab")
    form = open_form(plan, 11, 2, "lab")

    others = iter(["Theirs"])

    def slip_in(route: Route) -> None:
        alias = next(others, None) if route.request.method == "PATCH" else None
        if alias is not None:
            assert httpx.patch(f"{office.url}/instances/{lab['id']}", json={"alias": alias}).is_success
        route.continue_()

    plan.page.route(f"**/instances/{lab['id']}", slip_in)
    form.get_by_label("Alias").fill("Mine")
    form.get_by_role("button", name="Save").click()
    expect(form.get_by_role("alert")).to_contain_text("yours “Mine”, now “Theirs”")
    expect(form.get_by_label("Alias")).to_have_value("Theirs")
    assert office.instance("lab")["alias"] == "Theirs"
    form.get_by_role("button", name="Put mine in again").click()
    form.get_by_role("button", name="Save").click()
    expect(plan.page.get_by_text("lab is changed.")).to_be_visible()
    assert office.instance("lab")["alias"] == "Mine"


def test_what_others_change_is_seen_while_it_is_edited(plan: Plan, office: Office) -> None:
    lab = office.instance("lab")
    form = open_form(plan, 11, 2, "lab")
    form.get_by_label("Alias").fill("Mine")
    assert httpx.patch(f"{office.url}/instances/{lab['id']}", json={"height_m": 3.5}).is_success
    expect(form.get_by_label("Height [m]")).to_have_value("3.5")
    expect(form.get_by_label("Alias")).to_have_value("Mine")
    assert httpx.patch(f"{office.url}/instances/{lab['id']}", json={"alias": "Theirs"}).is_success
    expect(form.get_by_role("alert")).to_contain_text("yours “Mine”, now “Theirs”")
    expect(form.get_by_role("button", name="Save")).to_be_disabled()


def test_delete_asks_first(plan: Plan, office: Office) -> None:
    page = plan.page
    plan.click(11, 2)
    page.keyboard.press("Delete")
    dialog = page.get_by_role("dialog", name="Delete lab?")
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_be_hidden()
    assert "lab" in office.names()
    page.keyboard.press("Delete")
    page.get_by_role("dialog", name="Delete lab?").get_by_role("button", name="Delete").click()
    expect(page.get_by_text("lab is deleted.")).to_be_visible()
    assert "lab" not in office.names()


def test_all_of_it_by_keyboard(page: Page, office: Office) -> None:
    """A room is drawn, named, moved and deleted, and nothing is pointed at."""
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    page.locator("#stage").focus()
    keys = page.keyboard
    keys.press("r")
    for step in ("Shift+ArrowUp", "Shift+ArrowRight", "Shift+ArrowDown"):
        keys.press("Enter")
        keys.press(step)
    keys.press("Enter")
    keys.press("Enter")
    expect(page.get_by_text("Give it a name.")).to_be_visible()
    name = page.get_by_role("form", name="New room").get_by_label("Name")
    name.focus()
    keys.press("Control+a")
    keys.type("den")
    keys.press("Enter")
    expect(page.get_by_role("form", name="Edit den")).to_be_visible()
    before = office.instance("den")["pose"]["x_m"]
    page.locator("#stage").focus()
    keys.press("m")
    expect(page.get_by_role("form", name="Move den")).to_be_visible()
    keys.press("Shift+ArrowRight")
    page.get_by_role("button", name="Put it there").focus()
    keys.press("Enter")
    expect(page.get_by_text("den has its new place.")).to_be_visible()
    assert office.instance("den")["pose"]["x_m"] > before
    page.locator("#stage").focus()
    keys.press("Delete")
    page.get_by_role("dialog").get_by_role("button", name="Delete").focus()
    keys.press("Enter")
    expect(page.get_by_text("den is deleted.")).to_be_visible()
    assert "den" not in office.names()
