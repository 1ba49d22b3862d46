"""Stamps on the command line."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

import typer


def read_stamp(text: str) -> datetime:
    """raises InvalidInput for what is no ISO 8601 stamp with its offset"""
    from semap.timeline.stamp import parse_stamp, to_datetime  # noqa: PLC0415

    return to_datetime(parse_stamp(text))


From = Annotated[
    datetime | None,
    typer.Option(
        "--from", parser=read_stamp, metavar="STAMP", help="From then on, such as 2026-01-31T12:00:00Z."
    ),
]
To = Annotated[datetime | None, typer.Option("--to", parser=read_stamp, metavar="STAMP", help="Before then.")]
