"""README's figures are those of the page that has all of them."""

from __future__ import annotations

import re
from pathlib import Path

CHECKOUT = Path(__file__).parents[2]
NUMBER = re.compile(r"\d[\d,.]*\d|\d")


def test_the_five_figures_are_those_of_the_measurements() -> None:
    _, figures = (CHECKOUT / "README.md").read_text().split("## Five figures\n")
    rows = re.findall(r"^\| (?!\|).*\d.*$", figures, re.M)
    measured = set(NUMBER.findall((CHECKOUT / "docs/explanation/measurements.md").read_text()))
    assert len(rows) == 5
    assert {row: set(NUMBER.findall(row.rsplit("|", 2)[1])) - measured for row in rows} == {
        row: set() for row in rows
    }
