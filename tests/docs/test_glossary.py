"""The glossary is whole, and pages use its terms."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]
PRIVATE = re.compile(r"\b(calm|verges?|careful|whoever|take[sn]? back|took back|told|happenings)\b", re.I)
"""Words of semap's own for which the glossary has a term."""
GLOSSARY = CHECKOUT / "docs/reference/glossary.md"


def rows() -> list[list[list[str]]]:
    """The rows of each table with three columns, in their order."""
    tables = re.findall(
        r"\| term \| meaning \| source \|\n\|---\|---\|---\|\n((?:\|.*\n)+)", GLOSSARY.read_text()
    )
    return [
        [[cell.strip() for cell in row.strip("|\n").split(" | ")] for row in each.splitlines()]
        for each in tables
    ]


def test_each_term_has_one_sentence_and_a_source() -> None:
    found = [row for table in rows() for row in table]
    assert found
    for row in found:
        assert len(row) == 3, row
        term, meaning, source = row
        assert term, row
        assert source, row
        assert meaning.endswith("."), row
        assert ". " not in meaning, row


def test_each_term_is_there_once_and_in_order() -> None:
    tables = [[row[0].lower() for row in table] for table in rows()]
    assert all(each == sorted(each) for each in tables)
    times = Counter(term for table in tables for term in table)
    assert times == dict.fromkeys(times, 1)


@pytest.mark.parametrize("path", ["README.md", "ARCHITECTURE.md", "docs", "docs/how-to", "docs/explanation"])
def test_pages_use_the_terms(path: str) -> None:
    """In their prose; what is code, or the address of a link, may be called otherwise."""
    place = CHECKOUT / path
    for page in sorted(place.glob("*.md")) if place.is_dir() else [place]:
        prose = re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)", " ", page.read_text(), flags=re.S)
        assert PRIVATE.findall(prose) == [], page.name
