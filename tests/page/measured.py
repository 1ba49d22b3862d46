"""What is measured of the page: what breaks rules of access (axe), is off the screen, or too small for a finger."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from playwright.sync_api import Page

AXE = Path(__file__).parents[2] / "service" / "page" / "node_modules" / "axe-core" / "axe.min.js"
SEVERE = ("serious", "critical")
FINGER_PX = 44

OFF_THE_SCREEN = """() => {
    const shown = [...document.querySelectorAll("body *")].filter((each) =>
        each.checkVisibility() && !each.closest(".visually-hidden, .skip, .sketch, option, #stage"));
    const off = shown.filter((each) => {
        const {left, right, width, height} = each.getBoundingClientRect();
        return width > 0 && height > 0 && (left < -1 || right > innerWidth + 1);
    });
    if (document.documentElement.scrollWidth > innerWidth) off.unshift(document.documentElement);
    return off.map((each) => each.outerHTML.slice(0, 80));
}"""
SMALL_TARGETS = """(least) => [...document.querySelectorAll(
    "a, button, input, select, summary, textarea, [role=tab], [role=slider], [role=separator]")]
    .filter((each) => each.checkVisibility() && !each.closest(".visually-hidden"))
    .map((each) => [each, each.getBoundingClientRect()])
    .filter(([each, {width, height}]) => width > 0 && (width < least - 0.1 || height < least - 0.1))
    .map(([each, {width, height}]) => `${each.outerHTML.slice(0, 80)} ${width} x ${height}`)"""


def violations(page: Page) -> list[str]:
    """Serious and critical ones: the rule, and the first element that breaks it."""
    result: dict[str, Any] = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [
        f"{each['id']}: {each['nodes'][0]['html'][:120]}"
        for each in result["violations"]
        if each["impact"] in SEVERE
    ]
