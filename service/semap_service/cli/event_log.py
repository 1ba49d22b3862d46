"""semap log, semap plot"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.output import counted
from semap_service.cli.session import Dsn, database
from semap_service.cli.stamp import From, To

MapOption = Annotated[str, typer.Option("--map", help="The map whose events are meant.")]
Rules = Annotated[
    list[str] | None, typer.Option("--rule", help="Only events of this rule; may be given again.")
]
FORMATS = (".xes", ".json", ".jsonocel", ".csv", ".parquet")
MARGIN = 0.03


def log_commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="The log of events for other tools.")
    app.command("export")(export)
    app.callback()(_nothing)
    return app


def plot_commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Pictures of what happened.")
    app.command("timeline")(timeline)
    app.callback()(_nothing)
    return app


def _nothing() -> None:
    """Without it, typer would take a group of one command for that command."""


def export(
    file: Annotated[
        Path,
        typer.Argument(
            help="Where to: .xes (XES) or .json, .jsonocel (OCEL 2.0) for process mining; .csv or .parquet."
        ),
    ],
    map_name: MapOption,
    start: From = None,
    end: To = None,
    rules: Rules = None,
    case: Annotated[
        str, typer.Option(help="XES: whose life a trace is, that of each instance or of each track.")
    ] = "instance",
    retracted: Annotated[
        bool, typer.Option("--with-retracted", help="Also events that a recomputation took back or amended.")
    ] = False,
    dsn: Dsn = None,
) -> None:
    """Export the events of a map, in the order of event time."""
    from semap.event_log.ocel import write_ocel  # noqa: PLC0415
    from semap.event_log.table import write_csv, write_parquet  # noqa: PLC0415
    from semap.event_log.xes import write_xes  # noqa: PLC0415
    from semap.store.database import connect  # noqa: PLC0415
    from semap.store.event_log import Selection, log_entries  # noqa: PLC0415

    if file.suffix not in FORMATS:
        raise InvalidInput("there is no such format", f"The formats are {', '.join(FORMATS)}.", file.name)
    if case not in ("instance", "track"):
        raise InvalidInput("there is no such case", "The cases are instance and track.", "--case")
    _require_order(start, end)
    selection = Selection(map_name, start, end, rules, retracted)
    with (
        _written(file) as draft,
        database(dsn) as opened,
        connect(opened, "semap_read", application="semap log export") as connection,
    ):
        match file.suffix:
            case ".xes":
                count = write_xes(log_entries(connection, selection, case), draft, case)  # type: ignore[arg-type]
            case ".csv":
                count = write_csv(log_entries(connection, selection), draft)
            case ".parquet":
                count = write_parquet(log_entries(connection, selection), draft)
            case _:
                count = write_ocel(log_entries(connection, selection), draft)
    typer.echo(f"{counted(count, 'event')} written to {file}.")


def timeline(
    file: Annotated[Path, typer.Argument(help="Where to: .svg, .png or .pdf.")],
    map_name: MapOption,
    start: From = None,
    end: To = None,
    rules: Rules = None,
    dsn: Dsn = None,
) -> None:
    """Draw rooms with who was in them, doors with when they were open, and the events above them.

    Without --from and --to it shows all events of the map.
    """
    from semap.event_log.timeline import FORMATS as PICTURES  # noqa: PLC0415
    from semap.event_log.timeline import draw_timeline  # noqa: PLC0415
    from semap.store.database import connect  # noqa: PLC0415
    from semap.store.event_log import Selection, lanes, span_of  # noqa: PLC0415

    if file.suffix.lower() not in PICTURES:
        raise InvalidInput("there is no such picture", f"The formats are {', '.join(PICTURES)}.", file.name)
    _require_order(start, end)
    with (
        database(dsn) as opened,
        connect(opened, "semap_read", application="semap plot") as connection,
    ):
        span = span_of(connection, map_name)
        if span is None and (start is None or end is None):
            raise InvalidInput(
                "the map has no events yet", "Give --from and --to, or bring in movement.", map_name
            )
        first, last = start or span[0], end or span[1]  # type: ignore[index]
        if last <= first:
            raise InvalidInput("it ends before it begins", "Give the earlier time first.", "--from, --to")
        margin = (last - first) * MARGIN
        first, last = (start and first) or first - margin, (end and last) or last + margin
        found = lanes(connection, Selection(map_name, first, last, rules))
    with _written(file) as draft:
        draw_timeline(found, first, last, f"{map_name}: rooms, doors and events", draft)
    typer.echo(f"{counted(len(found), 'lane')} drawn to {file}.")


def _require_order(start: datetime | None, end: datetime | None) -> None:
    if start is not None and end is not None and end <= start:
        raise InvalidInput("it ends before it begins", "Give the earlier time first.", "--from, --to")


@contextmanager
def _written(file: Path) -> Iterator[Path]:
    """A file beside it that takes its place once it is whole.

    raises InvalidInput where it cannot be written
    """
    try:
        handle, name = tempfile.mkstemp(suffix=file.suffix, prefix=f".{file.stem}-", dir=file.parent)
    except OSError as error:
        raise InvalidInput(f"{file} cannot be written: {error.strerror}", "Check the folder.") from error
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        draft.chmod(0o644)
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
