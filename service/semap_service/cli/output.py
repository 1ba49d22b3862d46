"""What a command prints: tables for people, JSON for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any
from uuid import UUID

import typer

CONTROL = {
    code: f"\\u{code:04x}"
    for code in (*range(9), *range(11, 32), *range(127, 160), *range(0x2028, 0x202F), *range(0x2066, 0x206A))
}
"""What acts on a terminal or a line of text rather than being seen, in the words of JSON."""


def visible(text: str) -> str:
    """The text as a terminal may show it: names are what others gave, and a terminal obeys what it reads."""
    return text.translate(CONTROL)


def say(text: str, *, err: bool = False) -> None:
    """Print a line, or several, on standard output or standard error."""
    typer.echo(visible(text), err=err)


def print_json(value: object) -> None:
    """One JSON document, indented."""
    say(json.dumps(value, indent=2, default=_plain, ensure_ascii=False))


def print_json_line(value: object) -> None:
    """One JSON document on a line of its own, at once."""
    say(json.dumps(value, default=_plain, ensure_ascii=False))


def print_rows(rows: Sequence[Mapping[str, Any]], as_json: bool, empty: str) -> None:
    """Rows as a table, or as a JSON list; `empty` says what to do where there are none."""
    if as_json:
        print_json(list(rows))
        return
    if not rows:
        say(empty)
        return
    cells = [[_one_line(_cell(value)) for value in row.values()] for row in rows]
    titles = list(rows[0])
    widths = [max(len(line[i]) for line in [titles, *cells]) for i in range(len(titles))]
    for line in [titles, *cells]:
        say("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def counted(count: int, noun: str) -> str:
    """1 track, 2 tracks."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def clock(stamp: datetime) -> str:
    """A stamp for people, in UTC, to the nearest millisecond."""
    nearest = stamp + timedelta(microseconds=500)
    return f"{nearest:%Y-%m-%d %H:%M:%S}.{nearest.microsecond // 1000:03d}"


def _one_line(text: str) -> str:
    return visible(text).replace("\n", "\\n").replace("\t", "\\t")


def _cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, datetime):
        return clock(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return json.dumps(value)
    return str(value)


def _plain(value: object) -> str:
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, UUID):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no form in JSON")
