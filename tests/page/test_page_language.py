"""The page speaks the language of its reader, from whichever side that is read, with its dates and numbers."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from measured import DESKTOP, PHONE, TABLET, flaws, in_every_theme
from playwright.sync_api import Page, expect
from served import Office

SOURCES = Path(__file__).parents[2] / "service/page/src/language"
DIRECTIONS = {"de": "ltr", "ar": "rtl"}
TABS = {
    "de": ["Details", "Ereignisse", "Ändern", "Regeln", "Abfragen", "Import"],
    "ar": ["التفاصيل", "الأحداث", "تحرير", "القواعد", "الاستعلامات", "استيراد"],
}
SIZES = (DESKTOP, TABLET, PHONE, (320, 640))

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
def reader(language: str) -> dict[str, Any]:
    return {"locale": language, "timezone_id": "UTC"}


@pytest.fixture
def read(page: Page, office: Office) -> Page:
    """The page of somebody whose browser is set to the language; ann was in the kitchen on a winter day."""
    office.now = datetime(2026, 1, 5, 9, tzinfo=UTC)
    ann = office.track("ann")
    office.see(ann, 3, 2, after_s=-60)
    office.see(ann, 11, 2, after_s=-1.5)
    office.happen("entered", ann, "lab", after_s=-1.5)
    page.goto(office.page)
    page.wait_for_selector("#status[data-state=live]")
    return page


def test_all_of_it_is_in_the_readers_language(read: Page, language: str) -> None:
    html = read.locator("html")
    expect(html).to_have_attribute("lang", language)
    expect(html).to_have_attribute("dir", DIRECTIONS[language])
    expect(read.locator("#tabs [role=tab]")).to_have_text(TABS[language])
    assert english(read, language) == set()
    for tab in ("details", "events", "edit", "rules", "queries", "import"):
        read.locator(f"#tab-{tab}").click()
        assert (tab, english(read, language)) == (tab, set())
    read.keyboard.press("?")
    expect(read.get_by_role("dialog")).to_be_visible()
    assert english(read, language) == set()


def test_what_happened_and_when_is_told_in_it(read: Page, language: str) -> None:
    read.locator("#tab-events").click()
    event = read.locator("#event-list").get_by_role("button")
    # Names keep their own direction within a text that is read from right to left (UAX 9: FSI, PDI).
    expect(event).to_contain_text(
        {"de": "ann betrat Lab", "ar": "\u2068ann\u2069 دخل \u2068Lab\u2069"}[language]
    )
    event.click()
    expect(read.locator("#panel-details h2")).to_have_css("direction", DIRECTIONS[language])
    moment = {"de": "05.01.2026 08:59:58,5 UTC", "ar": "08:59:58.5 UTC"}[language]
    expect(read.locator("#panel-details")).to_contain_text(moment)


def test_another_language_is_chosen_and_kept(read: Page, language: str) -> None:
    read.keyboard.press("?")
    read.get_by_label(texts(language)["Language"]).select_option("en")
    expect(read.locator("html")).to_have_attribute("lang", "en")
    expect(read.locator("#tab-events")).to_have_text("Events")
    read.reload()
    expect(read.locator("html")).to_have_attribute("dir", "ltr")


@in_every_theme
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_everybody_can_use_it_in_every_language(read: Page) -> None:
    found: dict[str, list[str]] = {}
    for tab in ("events", "details", "rules"):
        read.locator(f"#tab-{tab}").click()
        found[tab] = flaws(read)
    assert found == {tab: [] for tab in found}
