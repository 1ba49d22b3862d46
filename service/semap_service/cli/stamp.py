"""Stamps on the command line."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

import typer

from semap.errors import InvalidInput


def read_stamp(text: str) -> datetime:
    """raises InvalidInput for what is no ISO 8601 stamp with its offset"""
    from semap.timeline.stamp import parse_stamp, to_datetime  # noqa: PLC0415

    try:
        return to_datetime(parse_stamp(text))
    except InvalidInput as error:
        raise InvalidInput(str(error), "Write it as 2026-01-31T12:00:00Z.") from error


From = Annotated[
    datetime | None,
    typer.Option(
        "--from", parser=read_stamp, metavar="STAMP", help="From then on, such as 2026-01-31T12:00:00Z."
    ),
]
AsOf = Annotated[
    datetime | None,
    typer.Option("--as-of", parser=read_stamp, metavar="STAMP", help="As it was then. [default: now]"),
]
To = Annotated[datetime | None, typer.Option("--to", parser=read_stamp, metavar="STAMP", help="Before then.")]


def require_order(start: datetime | None, end: datetime | None) -> None:
    """raises InvalidInput where a time ends before it begins"""
    if start is not None and end is not None and end <= start:
        raise InvalidInput("it ends before it begins", "Give the earlier time first.", "--from, --to")
