"""semap log"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.output import counted, say
from semap_service.cli.session import Dsn, database
from semap_service.cli.stamp import From, To, require_order
from semap_service.cli.written_file import written

if TYPE_CHECKING:
    from semap.model.event_log import Entry

MapOption = Annotated[str, typer.Option("--map", help="The map whose events are meant.")]
Rules = Annotated[
    list[str] | None, typer.Option("--rule", help="Only events of this rule; may be given again.")
]
FORMATS = (".xes", ".json", ".jsonocel", ".csv", ".parquet")


def log_commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="What happened, for other tools.")
    app.command("export")(export)
    app.command("mcap")(mcap)
    return app


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
        str, typer.Option(help="XES: whose life a trace is, that of each track or of each instance.")
    ] = "track",
    retracted: Annotated[
        bool, typer.Option("--with-retracted", help="Also events that a recomputation took back or amended.")
    ] = False,
    dsn: Dsn = None,
) -> None:
    """Export the events of a map, in the order of event time."""
    from semap.event_log.ocel import write_ocel  # noqa: PLC0415
    from semap.event_log.table import write_csv, write_parquet  # noqa: PLC0415
    from semap.event_log.xes import write_xes  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.event_log import Selection, log_entries  # noqa: PLC0415

    if file.suffix not in FORMATS:
        raise InvalidInput("there is no such format", f"The formats are {', '.join(FORMATS)}.", file.name)
    if case not in ("instance", "track"):
        raise InvalidInput("there is no such case", "The cases are track and instance.", "--case")
    require_order(start, end)
    selection = Selection(map_name, start, end, rules, retracted)
    seen = 0

    def noted(entries: Iterable[Entry]) -> Iterator[Entry]:
        nonlocal seen
        for entry in entries:
            seen += 1
            yield entry

    with (
        written(file) as draft,
        database(dsn, map_name) as opened,
        one_transaction(opened, "semap_read", application="semap log export") as connection,
    ):
        match file.suffix:
            case ".xes":
                count = write_xes(noted(log_entries(connection, selection, case)), draft, case)  # type: ignore[arg-type]
            case ".csv":
                count = write_csv(log_entries(connection, selection), draft)
            case ".parquet":
                count = write_parquet(log_entries(connection, selection), draft)
            case _:
                count = write_ocel(log_entries(connection, selection), draft)
    say(f"{counted(count, 'event')} written to {file}.")
    if seen > count:
        say(
            f"{counted(seen - count, 'event')} without a {case} left out: a trace is the life of one.",
            err=True,
        )


def mcap(
    file: Annotated[Path, typer.Argument(help="Where to: an MCAP file, which the Foxglove app opens.")],
    map_name: Annotated[str, typer.Option("--map", help="The map that is shown, with what happened on it.")],
    start: From = None,
    end: To = None,
    recording: Annotated[
        Path | None,
        typer.Option(help="A recording whose scans, images and boxes are put in: a bag or an MCAP file."),
    ] = None,
    frame: Annotated[str, typer.Option(help="Frame of the recording that is the map's.")] = "map",
    dsn: Dsn = None,
) -> None:
    """Write a map, its tracks, doors and events to an MCAP file: the topics of the bridge foxglove."""
    try:
        from semap_bridge.adapters.foxglove.layout import LAYOUT  # noqa: PLC0415
        from semap_bridge.adapters.foxglove.recorded import write_mcap  # noqa: PLC0415
    except ModuleNotFoundError as error:
        if error.name != "foxglove":
            raise
        raise InvalidInput("foxglove-sdk is not installed", "pip install 'semap[foxglove]'") from error
    from semap_ingest.recording.reading import Recording  # noqa: PLC0415

    from semap.store.database.connection import one_transaction  # noqa: PLC0415

    require_order(start, end)
    with (
        ExitStack() as opened,
        written(file) as draft,
        database(dsn, map_name) as server,
        one_transaction(server, "semap_read", application="semap log mcap") as connection,
    ):
        sensors = None if recording is None else opened.enter_context(Recording(recording))
        try:
            made = write_mcap(connection, map_name, draft, start, end, sensors, frame)
        except OSError as error:
            raise InvalidInput(
                f"{file} cannot be written: {error.strerror}", "See that there is room."
            ) from error
    typer.echo(f"{file} written: {made.start:%Y-%m-%d %H:%M:%S} to {made.end:%Y-%m-%d %H:%M:%S}, in it")
    typer.echo(
        ", ".join(f"{count} {what}" for what, count in sorted(made.counts.items())) or "nothing that moved"
    )
    typer.echo(f"Open it in the Foxglove app, with the layout {LAYOUT}")
