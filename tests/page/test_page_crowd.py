"""Where very many people are, crowds are counted, and no name lies on another or on somebody."""

from __future__ import annotations

import re
from typing import Any

import pytest
from plan import Plan
from playwright.sync_api import Page, expect
from served import Office

PEOPLE = 200
FROM_M, STEP_M = (0.6, 0.6), (0.68, 0.75)

# A picture of names begins as its canvas is cleared.
RECORD = """() => {
    const proto = CanvasRenderingContext2D.prototype;
    const [clear, write] = [proto.clearRect, proto.fillText];
    window.written = [];
    proto.clearRect = function (...box) {
        if (this.canvas.className === "labels") window.written = [];
        clear.apply(this, box);
    };
    proto.fillText = function (text, x, y) {
        if (this.canvas.className === "labels")
            window.written.push({text, x, y, width: this.measureText(text).width});
        const count = (pattern) => window.written.filter((each) => pattern.test(each.text)).length;
        document.documentElement.dataset.crowds = count(/^[0-9]+$/);
        document.documentElement.dataset.people = count(/^person /);
        write.call(this, text, x, y);
    };
}"""


@pytest.fixture
def crowded(page: Page, office: Office) -> Plan:
    """Two hundred people all over the office, who just do not touch each other."""
    page.add_init_script(f"({RECORD})()")
    for number in range(PEOPLE):
        row, column = divmod(number, 20)
        x_m, y_m = FROM_M[0] + column * STEP_M[0], FROM_M[1] + row * STEP_M[1]
        office.see(office.track(f"person {number}"), x_m, y_m, after_s=0)
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    return Plan.measured(page)


def written(page: Page) -> list[dict[str, Any]]:
    names: list[dict[str, Any]] = page.evaluate("window.written")
    return names


def test_crowds_are_counted_until_one_looks_nearer(crowded: Plan) -> None:
    page = crowded.page
    for _ in range(6):
        page.locator("#stage").press("-")
    expect(page.locator("html")).not_to_have_attribute("data-crowds", "0")
    crowds = [each for each in written(page) if each["text"].isdigit()]
    assert sum(int(each["text"]) for each in crowds) > PEOPLE // 2
    box = page.locator("#stage").bounding_box()
    assert box is not None
    middle = min(crowds, key=lambda each: abs(each["x"] - box["width"] / 2))
    page.mouse.click(box["x"] + middle["x"], box["y"] + middle["y"])
    for _ in range(6):
        page.locator("#stage").press("+")
    expect(page.locator("html")).to_have_attribute("data-crowds", "0")
    expect(page.locator("html")).not_to_have_attribute("data-people", "0")


def test_no_name_lies_on_another(crowded: Plan) -> None:
    page = crowded.page
    for _ in range(4):
        page.locator("#stage").press("+")
    expect(page.locator("html")).to_have_attribute("data-people", re.compile(r"[4-9]|\d\d"))
    names = written(page)
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            beside = abs(one["x"] - other["x"]) >= (one["width"] + other["width"]) / 2
            below = abs(one["y"] - other["y"]) >= 12
            assert beside or below, f"{one['text']} lies on {other['text']}"
