"""What an evaluation says: a table for people, the same as JSON, and a picture."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, object]


@dataclass(frozen=True)
class Report:
    """One part of an evaluation.

    aim      what it should show
    holds    whether it does
    rows     of the table; figures with their unit in the name
    details  what a table has no room for
    draw     makes the picture; None: there is none
    """

    name: str
    aim: str
    holds: bool
    rows: tuple[Row, ...]
    details: tuple[str, ...] = ()
    draw: Callable[[], Figure] | None = None


def table(rows: Sequence[Row]) -> str:
    """Columns as wide as they need to be; a row without one of them has it empty."""
    titles = list(dict.fromkeys(title for row in rows for title in row))
    lines = [titles, *([_said(row.get(title)) for title in titles] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(titles))]
    return "\n".join(
        "  " + "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
        for line in lines
    )


def write(report: Report, folder: Path) -> tuple[Path, ...]:
    """Write NAME.json and NAME.png into a folder; gives what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    document = {
        "name": report.name,
        "aim": report.aim,
        "holds": report.holds,
        "rows": [dict(row) for row in report.rows],
        "details": list(report.details),
    }
    data = folder / f"{report.name}.json"
    data.write_text(json.dumps(document, indent=2) + "\n")
    if report.draw is None:
        return (data,)
    picture = folder / f"{report.name}.png"
    report.draw().savefig(picture, dpi=120)
    return (data, picture)


def _said(value: object) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
