"""The page looks as it did: pictures of its states are compared with those that were kept.

They are renewed by `./dev test tests/page/test_page_references.py --renew-pictures`; then look at what git says changed.

The same on every machine: data and moment are fixed, Chromium draws by software, with the fonts that come with
matplotlib and without hinting. Pictures are kept at half their size. What is compared are means over squares: smoothing
of edges, which differs between versions of Chromium, hardly changes them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from measured import CHROMIUM, DESKTOP, PATIENCE_MS, PHONE, SOFTWARE_GL, TABLET
from patience import until
from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright
from served import Office, Served, brought_in, house
from server import database_with_slot

from semap.cluster import Cluster

KEPT = Path(__file__).parent / "references"
NINE = datetime(2026, 1, 5, 9, tzinfo=UTC)
SQUARE_PX = 4
"""Of a picture of half the size."""
NOTICED = 0.05
"""How much the mean of a square may differ, of 1."""
MOST_SQUARES = 12

# Who changed the map, and when.
DIFFERS_EACH_TIME = "#panel-edit details { visibility: hidden }"

FONTS = """<?xml version="1.0"?>
<!DOCTYPE fontconfig SYSTEM "fonts.dtd">
<fontconfig>
  <dir>{fonts}</dir>
  <cachedir>{cache}</cachedir>
  <alias><family>system-ui</family><prefer><family>DejaVu Sans</family></prefer></alias>
  <alias><family>sans-serif</family><prefer><family>DejaVu Sans</family></prefer></alias>
  <alias><family>monospace</family><prefer><family>DejaVu Sans Mono</family></prefer></alias>
  <match target="font">
    <edit name="hinting" mode="assign"><bool>false</bool></edit>
    <edit name="hintstyle" mode="assign"><const>hintnone</const></edit>
    <edit name="rgba" mode="assign"><const>none</const></edit>
  </match>
</fontconfig>
"""

Pixels = np.ndarray[Any, np.dtype[np.float32]]
Bring = Callable[[Page, str], None]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Chromium with fonts that are the same everywhere."""
    folder = tmp_path_factory.mktemp("fonts")
    config = folder / "fonts.conf"
    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    config.write_text(FONTS.format(fonts=fonts, cache=folder / "cache"))
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as driver:
        running = driver.chromium.launch(
            executable_path=CHROMIUM,
            args=[*SOFTWARE_GL, "--font-render-hinting=none", "--disable-lcd-text"],
            env={**os.environ, "FONTCONFIG_FILE": str(config)},
        )
        yield running
        running.close()


@pytest.fixture(scope="module")
def buildings(cluster: Cluster, template: str) -> Iterator[str]:
    """A service of its own, whose ids, and so the colours of people, are the same in each run."""
    with database_with_slot(cluster, template) as dsn:
        running = Served(dsn)
        try:
            running.start()
            _live_in(Office.bring_in(running.url, dsn, "office"))
            rooms = (("cellar", 0, 0, 8, 4), ("hall", 8, 0, 12, 4)), (("attic", 0, 0, 8, 4),)
            brought_in(running, "tower", house(("ground", 0, rooms[0]), ("first floor", 3, rooms[1])))
            tower = Office.at(running, "tower")
            tower.now = NINE
            for name, *place in (("Ann", 2, 3, 0), ("Bob", 10, 1, 0), ("Cid", 5, 3, 3)):
                tower.see(tower.track(str(name)), place[0], place[1], after_s=5, z_m=place[2])
            tower.close()
            yield running.url
        finally:
            running.stop()


def _live_in(office: Office) -> None:
    """Three people walk through the office, one of them already two hours before."""
    office.now = NINE
    people = [office.track(name) for name in ("Ann", "Bob", "Cid")]
    office.see(people[1], 3, 2, after_s=-7200)
    office.see(people[1], -20, 2, after_s=-3600)
    for number, person in enumerate(people):
        for second in range(12):
            office.see(person, 1 + second * 0.8, 2 + number + second * 0.15, after_s=second)
    office.happen("entered", people[0], "lab", after_s=6)
    office.happen("left", people[1], "kitchen", after_s=8)
    office.happen("left_then_closed", people[1], "kitchen", after_s=9, measures={"gap_s": 1.1})
    office.close()


def _tab(tab: str) -> Bring:
    return lambda page, _: page.locator(f"#tab-{tab}").click()


def _event(page: Page, _: str) -> None:
    page.locator("#tab-events").click()
    page.locator("#event-list").get_by_role("button").first.click()
    expect(page.locator("#panel-details h2")).to_contain_text("closed the door")


def _named(name: str) -> Bring:
    """Somebody, or something, in the panel *Details*."""

    def bring(page: Page, _: str) -> None:
        page.locator("#tab-details").click()
        page.locator("#panel-details").get_by_role("button", name=name, exact=True).click()
        expect(page.locator("#panel-details h2").first).to_have_text(name)

    return bring


def _edit(page: Page, _: str) -> None:
    _named("Kitchen")(page, _)
    page.locator("#tab-edit").click()
    expect(page.get_by_role("form", name="Edit kitchen")).to_be_visible()


def _drawing(page: Page, _: str) -> None:
    box = page.locator("#stage").bounding_box()
    assert box is not None
    page.keyboard.press("r")
    for x, y in ((0.55, 0.1), (0.8, 0.1), (0.8, 0.35)):
        page.mouse.click(box["x"] + box["width"] * x, box["y"] + box["height"] * y)


def _writing(page: Page, _: str) -> None:
    page.locator("#tab-rules").click()
    page.get_by_role("button", name="Write a rule").click()
    page.get_by_label("Tell me when …").select_option("Somebody stays long")
    expect(page.locator("#rule-verdict")).to_contain_text("Right.")
    expect(page.get_by_role("region", name="Dry run")).to_contain_text("It would have made")


def _heat(page: Page, _: str) -> None:
    page.locator(".legend summary").click()
    page.get_by_label("Colours of the rooms").select_option("hours of the week")
    expect(page.locator(".legend summary")).to_contain_text("Hours that people spent there")


def _help(page: Page, _: str) -> None:
    page.get_by_role("button", name="Keys and help").click()


def _at(address: str) -> Bring:
    def bring(page: Page, url: str) -> None:
        page.goto("about:blank")
        page.goto(f"{url}/#{address}")

    return bring


def _in(language: str) -> Bring:
    def bring(page: Page, _: str) -> None:
        page.evaluate(f"localStorage.setItem('semap.language', '{language}')")
        page.reload()
        expect(page.locator("html")).to_have_attribute("lang", language)
        page.locator("#tab-events").click()

    return bring


STATES: dict[str, tuple[Bring, tuple[int, int], str]] = {
    "events": (_tab("events"), DESKTOP, "light"),
    "event": (_event, DESKTOP, "dark"),
    "event-phone": (_event, PHONE, "light"),
    "details": (_tab("details"), TABLET, "light"),
    "room": (_named("Kitchen"), DESKTOP, "light"),
    "room-phone": (_named("Kitchen"), PHONE, "dark"),
    "person": (_named("Bob"), DESKTOP, "dark"),
    "person-phone": (_named("Bob"), PHONE, "light"),
    "edit": (_edit, DESKTOP, "light"),
    "drawing": (_drawing, DESKTOP, "dark"),
    "rules": (_tab("rules"), TABLET, "dark"),
    "writing": (_writing, DESKTOP, "light"),
    "writing-phone": (_writing, PHONE, "dark"),
    "queries": (_tab("queries"), PHONE, "light"),
    "import": (_tab("import"), TABLET, "light"),
    "space": (_at("map=office&view=space&at=2026-01-05T09:00:11Z"), DESKTOP, "dark"),
    "apart": (_at("map=tower&view=space&storey=*&storeys=apart&at=2026-01-05T09:00:11Z"), DESKTOP, "light"),
    "apart-phone": (
        _at("map=tower&view=space&storey=*&storeys=apart&at=2026-01-05T09:00:11Z"), PHONE, "dark",
    ),
    "heat": (_heat, TABLET, "dark"),
    "help": (_help, PHONE, "light"),
    "german": (_in("de"), DESKTOP, "light"),
    "arabic-phone": (_in("ar"), PHONE, "dark"),
    "no_map": (_at("map=none"), TABLET, "light"),
}  # fmt: skip


@pytest.fixture
def reader() -> dict[str, Any]:
    return {"timezone_id": "UTC", "locale": "en", "bypass_csp": True}


def picture(page: Page) -> Pixels:
    """What is seen once it is at rest: half its size, red, green and blue from 0 to 1."""
    page.mouse.move(0, 0)
    seen: list[bytes] = []

    def is_at_rest() -> bool:
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        seen.append(page.screenshot(animations="disabled", caret="hide"))
        return len(seen) > 2 and seen[-1] == seen[-2] == seen[-3]

    until(is_at_rest)
    whole = Image.open(BytesIO(seen[-1])).convert("RGB")
    half: Pixels = np.asarray(whole.reduce(2), np.float32) / 255
    return half


def squares_that_differ(one: Pixels, other: Pixels) -> Pixels:
    """Of each square, whether its mean colour differs by more than one would fail to notice."""
    height, width = (length // SQUARE_PX * SQUARE_PX for length in one.shape[:2])

    def means(pixels: Pixels) -> Pixels:
        shape = height // SQUARE_PX, SQUARE_PX, width // SQUARE_PX, SQUARE_PX, 3
        mean: Pixels = pixels[:height, :width].reshape(shape).mean(axis=(1, 3))
        return mean

    differs: Pixels = (np.abs(means(one) - means(other)).max(axis=-1) > NOTICED).astype(np.float32)
    return differs


def brought(page: Page, url: str, state: str) -> None:
    page.clock.set_fixed_time(NINE + timedelta(minutes=1))
    page.goto(f"{url}/#map=office&at=2026-01-05T09:00:10.500Z")
    page.wait_for_selector("#status[data-state=past]")
    STATES[state][0](page, url)
    page.add_style_tag(content=DIFFERS_EACH_TIME)
    page.wait_for_load_state("networkidle")


def save(pixels: Pixels, file: Path) -> None:
    """In steps of a 64th, which is small and far below what is noticed."""
    steps = np.minimum(np.round(pixels * 64) * 4, 255).astype(np.uint8)
    Image.fromarray(steps).save(file, optimize=True)


@pytest.mark.usefixtures("fails_requests")
@pytest.mark.parametrize(
    ("state", "size", "theme"), [(name, size, theme) for name, (_, size, theme) in STATES.items()],
    ids=list(STATES),
)  # fmt: skip
def test_it_looks_as_it_did(
    page: Page, buildings: str, state: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    brought(page, buildings, state)
    seen, file = picture(page), KEPT / f"{state}.png"
    if request.config.getoption("--renew-pictures"):
        save(seen, file)
        return
    kept = np.asarray(Image.open(file).convert("RGB"), np.float32) / 255
    differs = squares_that_differ(seen, kept)
    if differs.sum() <= MOST_SQUARES:
        return
    large = np.kron(differs, np.ones((SQUARE_PX, SQUARE_PX), np.float32))
    marked = seen.copy()
    marked[: large.shape[0], : large.shape[1], 0] = np.maximum(
        seen[: large.shape[0], : large.shape[1], 0], large
    )
    beside = tmp_path / f"{state}.png"
    save(np.hstack([kept, seen, marked]), beside)
    rows, columns = np.nonzero(differs)
    pytest.fail(
        f"{state} looks otherwise, between ({2 * SQUARE_PX * columns.min()}, {2 * SQUARE_PX * rows.min()}) and"
        f" ({2 * SQUARE_PX * (columns.max() + 1)}, {2 * SQUARE_PX * (rows.max() + 1)}) px, in {int(differs.sum())}"
        f" squares of {differs.size}: {beside} shows what was kept, what is seen, and where it differs."
        " If it shall look so: ./dev test tests/page/test_page_references.py --renew-pictures"
    )


CHANGES = {
    "a panel is gone": "#side > * { display: none }",
    "a panel moves": "#side { transform: translateX(10px) }",
    "the legend is gone": ".legend { visibility: hidden }",
    "the buttons move": ".stage-tools { transform: translateY(12px) }",
    "a label is gone": "#panel-details h2 { visibility: hidden }",
    "the tabs are larger": "#tabs button { font-size: 15px !important }",
    "names are not written": "canvas.labels { visibility: hidden }",
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=list(CHANGES))
def test_what_changes_is_noticed(page: Page, buildings: str, change: str) -> None:
    brought(page, buildings, "room")
    before = picture(page)
    page.add_style_tag(content=change)
    assert squares_that_differ(before, picture(page)).sum() > MOST_SQUARES


# As no version of a browser smooths edges: all of it a third of a pixel beside, or blurred.
SMOOTHINGS = {
    "beside": "body { transform: translate(0.3px, 0.3px) }",
    "blurred": "body { filter: blur(0.35px) }",
}


@pytest.mark.parametrize("smoothing", SMOOTHINGS.values(), ids=list(SMOOTHINGS))
def test_smoothing_is_not_noticed(page: Page, buildings: str, smoothing: str) -> None:
    brought(page, buildings, "room")
    before = picture(page)
    page.add_style_tag(content=smoothing)
    after = picture(page)
    assert not np.array_equal(before, after)
    assert squares_that_differ(before, after).sum() <= MOST_SQUARES
