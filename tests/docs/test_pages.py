"""Every command of the documentation does what its page says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from transcript import Session, blocks

CHECKOUT = Path(__file__).parents[2]


OTHERS = ("index", "tutorial", "client")
PAGES = (
    "README.md",
    "docs/tutorial.md",
    "docs/client.md",
    "docs/how-to/own-building.md",
    "docs/how-to/own-tracker.md",
    "docs/how-to/tokens.md",
    "docs/how-to/write-a-map.md",
)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_true(reader: Session, page: str) -> None:
    if "$ curl " in (CHECKOUT / page).read_text() and shutil.which("curl") is None:
        pytest.skip("there is no curl: apt-get install curl")
    reader.follow(CHECKOUT / page)


@pytest.mark.slow
def test_the_page_about_recordings_is_true(reader: Session) -> None:
    reader.follow(CHECKOUT / "docs/how-to/recording.md")


def test_every_page_for_beginners_that_shows_commands_is_followed() -> None:
    """Those about one part of semap are held true by the tests of that part."""
    docs = CHECKOUT / "docs"
    pages = [CHECKOUT / "README.md", *docs.glob("how-to/*.md"), *(docs / f"{name}.md" for name in OTHERS)]
    shown = {
        str(page.relative_to(CHECKOUT))
        for page in pages
        if any(block.kind in ("console", "pycon") for block in blocks(page.read_text()))
    }
    assert shown == {*PAGES, "docs/how-to/recording.md"}
