"""The plan in the browser, with the pointer in metres of the map."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

from playwright.sync_api import Page, expect

Point = tuple[float, float]

PATIENCE_S = 120.0

# What is written on a canvas leaves no trace in the document.
RECORD = """() => {
    window.written = new Map();
    const note = () => { document.documentElement.dataset.written = [...window.written.keys()].join(", "); };
    window.forget = () => { window.written.clear(); note(); };
    const write = CanvasRenderingContext2D.prototype.fillText;
    CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
        if (this.canvas.className === "labels")
            window.written.set(text, {x, y, width: this.measureText(text).width, direction: this.direction});
        note();
        write.call(this, text, x, y);
    };
}"""


def until_written(page: Page, name: str) -> None:
    """Until the name is on the picture; `RECORD` runs in the page from its beginning."""
    expect(page.locator("html")).to_have_attribute("data-written", re.compile(re.escape(name)))


@dataclass
class Plan:
    """Where pixels are in the map is asked of the page itself: of the corners of a room that is drawn."""

    page: Page
    zero_px: Point
    px_per_m: Point

    @classmethod
    def measured(cls, page: Page) -> Plan:
        """The plan as it lies now, by two corners that are placed and given up again."""
        box = page.locator("#stage").bounding_box()
        assert box is not None
        far = [
            (box["x"] + box["width"] * a, box["y"] + box["height"] * b)
            for a, b in ((0.03, 0.05), (0.9, 0.95))
        ]
        page.keyboard.press("r")
        for x, y in far:
            page.mouse.click(x, y)
        page.get_by_text("Corners in metres").click()
        values = [
            float(page.get_by_label(f"{axis} of corner {i}").input_value()) for i in (1, 2) for axis in "xy"
        ]
        page.get_by_role("button", name="Cancel").click()
        (ax, ay), (bx, by) = far
        x1, y1, x2, y2 = values
        px_per_m = ((bx - ax) / (x2 - x1), (by - ay) / (y2 - y1))
        return cls(page, (ax - x1 * px_per_m[0], ay - y1 * px_per_m[1]), px_per_m)

    def pixel(self, x_m: float, y_m: float) -> Point:
        return (self.zero_px[0] + x_m * self.px_per_m[0], self.zero_px[1] + y_m * self.px_per_m[1])

    def click(self, x_m: float, y_m: float) -> None:
        self.page.mouse.click(*self.pixel(x_m, y_m))

    def finds(self, x_m: float, y_m: float, text: str) -> None:
        """What is under the pointer there says this, as soon as what moves has come to rest."""
        x, y = self.pixel(x_m, y_m)
        card = self.page.locator(".hover-card")
        until_s = time.monotonic() + PATIENCE_S
        said = ""
        while text not in said:
            assert time.monotonic() < until_s, f"{said!r} is there instead of {text!r}"
            self.page.mouse.move(x + 1, y)
            self.page.mouse.move(x, y)
            said = card.inner_text() if card.count() else ""

    def drag(self, start: Point, end: Point) -> None:
        self.page.mouse.move(*self.pixel(*start))
        self.page.mouse.down()
        self.page.mouse.move(*self.pixel(*end), steps=4)
        self.page.mouse.up()
