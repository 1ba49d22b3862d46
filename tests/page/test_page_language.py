"""The page speaks the language of its reader, from whichever side that is read, with its dates and numbers."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from measured import AXE, OFF_THE_SCREEN, violations
from playwright.sync_api import Browser, Page, expect
from served import Office

SOURCES = Path(__file__).parents[2] / "service/page/src/language"
DIRECTIONS = {"de": "ltr", "ar": "rtl"}
TABS = {
    "de": ["Details", "Ereignisse", "Ändern", "Regeln", "Abfragen", "Import"],
    "ar": ["التفاصيل", "الأحداث", "تحرير", "القواعد", "الاستعلامات", "استيراد"],
}
SIZES = ((1280, 800), (820, 1180), (390, 844), (320, 640))

SAID = """() => [
    document.body.innerText,
    ...[...document.querySelectorAll("[aria-label], [title], [placeholder]")].flatMap((each) =>
        ["aria-label", "title", "placeholder"].map((name) => each.getAttribute(name) ?? "")),
]"""


def texts(language: str) -> dict[str, str]:
    """The catalogue of a language: English and what it is there."""
    lines = re.findall(
        r'^  ("(?:[^"\\]|\\.)*"|\w+):\s*("(?:[^"\\]|\\.)*"),$',
        (SOURCES / f"{language}.ts").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    return {key if key[0] != '"' else json.loads(key): json.loads(said) for key, said in lines}


def english(page: Page, language: str) -> set[str]:
    """Texts of two words and more that the page says in English all the same."""
    said = "\n".join(page.evaluate(SAID))
    long = {
        text
        for text, there in texts(language).items()
        if re.search(r"[a-z]{2,} [a-z]{2,}", text) and "{" not in text and text != there
    }
    return {text for text in long if text in said}


@pytest.fixture(params=DIRECTIONS)
def language(request: pytest.FixtureRequest) -> str:
    chosen: str = request.param
    return chosen


@pytest.fixture
def reader(browser: Browser, office: Office, language: str) -> Iterator[Page]:
    """Somebody whose browser is set to the language; ann was in the kitchen on a winter day."""
    office.now = datetime(2026, 1, 5, 9, tzinfo=UTC)
    ann = office.track("ann")
    office.see(ann, 3, 2, after_s=-60)
    office.see(ann, 11, 2, after_s=-1.5)
    office.happen("entered", ann, "lab", after_s=-1.5)
    context = browser.new_context(
        viewport={"width": 1280, "height": 800}, locale=language, timezone_id="UTC", reduced_motion="reduce"
    )
    page = context.new_page()
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    yield page
    context.close()


def test_all_of_it_is_in_the_readers_language(reader: Page, language: str) -> None:
    html = reader.locator("html")
    expect(html).to_have_attribute("lang", language)
    expect(html).to_have_attribute("dir", DIRECTIONS[language])
    expect(reader.locator("#tabs [role=tab]")).to_have_text(TABS[language])
    assert english(reader, language) == set()
    for tab in ("details", "events", "edit", "rules", "queries", "import"):
        reader.locator(f"#tab-{tab}").click()
        assert (tab, english(reader, language)) == (tab, set())
    reader.keyboard.press("?")
    expect(reader.get_by_role("dialog")).to_be_visible()
    assert english(reader, language) == set()


def test_what_happened_and_when_is_told_in_it(reader: Page, language: str) -> None:
    reader.locator("#tab-events").click()
    event = reader.locator("#event-list").get_by_role("button")
    # Names keep their own direction within a text that is read from right to left (UAX 9: FSI, PDI).
    expect(event).to_contain_text(
        {"de": "ann betrat Lab", "ar": "\u2068ann\u2069 دخل \u2068Lab\u2069"}[language]
    )
    event.click()
    expect(reader.locator("#panel-details h2")).to_have_css("direction", DIRECTIONS[language])
    moment = {"de": "05.01.2026 08:59:58,5 UTC", "ar": "08:59:58.5 UTC"}[language]
    expect(reader.locator("#panel-details")).to_contain_text(moment)


def test_another_language_is_chosen_and_kept(reader: Page, language: str) -> None:
    reader.keyboard.press("?")
    reader.get_by_label(texts(language)["Language"]).select_option("en")
    expect(reader.locator("html")).to_have_attribute("lang", "en")
    expect(reader.locator("#tab-events")).to_have_text("Events")
    reader.reload()
    expect(reader.locator("html")).to_have_attribute("dir", "ltr")


@pytest.mark.skipif(not AXE.is_file(), reason="there is no axe-core: npm ci in service/page")
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_everybody_can_use_it_in_every_language(reader: Page, theme: str) -> None:
    reader.emulate_media(color_scheme="dark" if theme == "dark" else "light")
    reader.evaluate(AXE.read_text())
    for width, height in SIZES:
        reader.set_viewport_size({"width": width, "height": height})
        for tab in ("events", "details", "rules"):
            reader.locator(f"#tab-{tab}").click()
            assert (width, tab, reader.evaluate(OFF_THE_SCREEN)) == (width, tab, [])
            assert (width, tab, violations(reader)) == (width, tab, [])
