"""What is measured of the page in windows of all sizes: rules of access (axe), what is off the screen, what a finger misses."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SOFTWARE_GL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
PATIENCE_MS = 120_000

AXE = Path(__file__).parents[2] / "service" / "page" / "node_modules" / "axe-core" / "axe.min.js"
SEVERE = ("serious", "critical")
FINGER_PX = 44

DESKTOP, TABLET, PHONE = (1280, 800), (820, 1180), (390, 844)
LARGEST_TOUCHED_PX = 1024

in_every_size = pytest.mark.parametrize("size", [DESKTOP, TABLET, PHONE], ids=["desktop", "tablet", "phone"])
in_every_theme = pytest.mark.parametrize("theme", ["light", "dark"])

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


def flaws(page: Page) -> list[str]:
    """What not everybody can use: what breaks a rule, is off the screen, or is too small for a finger, on a touch screen."""
    found: list[str] = violations(page) + page.evaluate(OFF_THE_SCREEN)
    if is_touched(page):
        found += page.evaluate(SMALL_TARGETS, FINGER_PX)
    return found


def is_touched(page: Page) -> bool:
    assert page.viewport_size is not None
    return page.viewport_size["width"] <= LARGEST_TOUCHED_PX


def violations(page: Page) -> list[str]:
    """Serious and critical ones: the rule, and the first element that breaks it."""
    if not AXE.is_file():
        pytest.skip("there is no axe-core: npm ci in service/page")
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text())
    result: dict[str, Any] = page.evaluate("axe.run(document, {resultTypes: ['violations']})")
    return [
        f"{each['id']}: {each['nodes'][0]['html'][:120]}"
        for each in result["violations"]
        if each["impact"] in SEVERE
    ]


def take_picture(page: Page, request: pytest.FixtureRequest, state: str = "") -> None:
    """Writes a picture of the page into the folder of `--screenshots`, where there is one."""
    folder = request.config.getoption("--screenshots")
    if folder:
        Path(folder).mkdir(parents=True, exist_ok=True)
        page.screenshot(path=Path(folder) / f"{request.node.name}{state}.png")
