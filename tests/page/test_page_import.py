"""Files that are dropped on the page become maps, with what was found in them; what is none is told with its remedy."""

from __future__ import annotations

import base64

import httpx
from playwright.sync_api import Page, expect
from served import Served, building

# A job has a process of its own, which gives way to all others: on a busy machine its turn comes seldom.
JOB_PATIENCE_MS = 180_000

DROP = """([name, data]) => {
    const bytes = Uint8Array.from(atob(data), (sign) => sign.charCodeAt(0));
    const files = new DataTransfer();
    files.items.add(new File([bytes], name));
    const options = {dataTransfer: files, bubbles: true, cancelable: true};
    const over = document.getElementById("stage");
    for (const type of ["dragenter", "dragover", "drop"]) over.dispatchEvent(new DragEvent(type, options));
}"""


def drop(page: Page, name: str, data: bytes) -> None:
    page.evaluate(DROP, [name, base64.b64encode(data).decode()])


def open_page(page: Page, served: Served) -> None:
    page.goto(served.url)
    page.wait_for_selector("#tabs")


def test_a_dropped_building_is_shown(page: Page, served: Served) -> None:
    open_page(page, served)
    drop(page, "annexe.geojson", building(("den", 0, 0, 4, 3), ("hall", 4, 0, 9, 3), ("none", 1, 1, 1, 1)))
    imports = page.get_by_role("list", name="Imports")
    expect(imports.get_by_text("annexe: 2 Room")).to_be_visible(timeout=JOB_PATIENCE_MS)
    expect(imports.get_by_text("none")).to_be_visible()
    expect(page.locator("#map-choice")).to_have_value("annexe")
    page.wait_for_selector("#status[data-state=live]")
    found = httpx.get(f"{served.url}/rooms", params={"map": "annexe"}).json()["rooms"]
    assert [each["name"] for each in found] == ["den", "hall"]
    changes = httpx.get(f"{served.url}/maps/annexe/changes").json()["changes"]
    assert changes[0]["message"] == "import annexe.geojson"


def test_what_is_no_map_is_told_with_a_remedy(page: Page, served: Served) -> None:
    open_page(page, served)
    drop(page, "broken.geojson", b"{")
    card = page.get_by_role("list", name="Imports").get_by_role("listitem").filter(has_text="broken.geojson")
    expect(card.get_by_role("alert")).to_contain_text("JSON", timeout=JOB_PATIENCE_MS)
    card.get_by_role("button", name="Put away broken.geojson").click()
    expect(card).to_be_hidden()
    drop(page, "picture.png", b"")
    expect(page.get_by_text("picture.png is no map or building that semap reads")).to_be_visible()


def test_a_file_is_chosen_instead_of_dropped(page: Page, served: Served) -> None:
    open_page(page, served)
    page.locator("#tab-import").click()
    with page.expect_file_chooser() as chooser:
        page.get_by_role("button", name="Choose files…").click()
    chooser.value.set_files(
        {"name": "shed.geojson", "mimeType": "application/geo+json", "buffer": building(("shed", 0, 0, 2, 2))}
    )
    shed = page.get_by_role("list", name="Imports").get_by_text("shed: 1 Room")
    expect(shed).to_be_visible(timeout=JOB_PATIENCE_MS)
    expect(page.locator("#map-choice")).to_have_value("shed")
