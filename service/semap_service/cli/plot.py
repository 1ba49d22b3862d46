"""semap plot"""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.event_log import MapOption, Rules
from semap_service.cli.output import clock, counted, say
from semap_service.cli.session import Dsn, database
from semap_service.cli.stamp import From, To, read_stamp, require_order
from semap_service.cli.written_file import written

File = Annotated[Path, typer.Argument(help="Where to: .svg, .png or .pdf.")]
Storey = Annotated[str | None, typer.Option(help="Only what is on this storey.")]
MARGIN = 0.03


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Pictures of a map and of what happened on it.")
    app.command("plan")(plan)
    app.command("trajectories")(trajectories)
    app.command("timeline")(timeline)
    return app


def plan(
    file: File,
    map_name: Annotated[str, typer.Option("--map", help="The map to be drawn.")],
    at: Annotated[
        datetime | None,
        typer.Option(
            parser=read_stamp, metavar="STAMP", help="As of then. [default: the last that is known]"
        ),
    ] = None,
    storey: Storey = None,
    dsn: Dsn = None,
) -> None:
    """Draw a map from above: rooms by how many are in them, doors by how they stand, and who is where.

    People have their heading, a ring of two standard deviations, and the way of their last ten seconds.
    """
    from semap.model.plan import Person  # noqa: PLC0415
    from semap.picture.plan import draw_plan  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.motion.moment import extent, moment  # noqa: PLC0415
    from semap.store.motion.plan import things  # noqa: PLC0415

    _require_picture(file)
    with (
        database(dsn, map_name) as opened,
        one_transaction(opened, "semap_read", application="semap plot") as connection,
    ):
        shown = things(connection, map_name, storey)
        span = extent(connection, map_name)
        stamp = at or (span[1] if span else None)
        now = None if stamp is None else moment(connection, map_name, stamp)
    on_storey = {each.instance_id for each in shown}
    seen = [
        each
        for each in (now.tracks if now else ())
        if storey is None or not each.rooms or on_storey & set(each.rooms)
    ]
    persons = [
        Person(
            each.name,
            each.x_m,
            each.y_m,
            each.heading_rad,
            each.std_m,
            [(x_m, y_m) for x_m, y_m, _ in each.trail],
            each.std_across_m,
            each.std_yaw_rad,
        )
        for each in seen
    ]
    with written(file) as draft:
        draw_plan(
            shown,
            persons,
            now.occupants if now else {},
            {each.instance_id: each.state for each in now.doors} if now else {},
            map_name if stamp is None else f"{map_name}, {clock(stamp)} UTC",
            draft,
        )
    things_drawn = counted(len(shown), "thing")
    say(f"{things_drawn} and {counted(len(persons), 'track')} drawn to {file}.")


def trajectories(
    file: File,
    map_name: MapOption,
    start: From = None,
    end: To = None,
    tracks: Annotated[
        list[str] | None, typer.Option("--track", help="Only the tracks of this name; may be given again.")
    ] = None,
    storey: Storey = None,
    dsn: Dsn = None,
) -> None:
    """Draw where tracks went, over the plan, in a colour for each name.

    Without --from and --to it shows all that is stored.
    """
    from semap.picture.plan import draw_trajectories  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.motion.moment import extent  # noqa: PLC0415
    from semap.store.motion.plan import things, ways  # noqa: PLC0415
    from semap.timeline.stamp import to_datetime, to_us  # noqa: PLC0415

    _require_picture(file)
    require_order(start, end)
    with (
        database(dsn, map_name) as opened,
        one_transaction(opened, "semap_read", application="semap plot") as connection,
    ):
        shown = things(connection, map_name, storey)
        span = extent(connection, map_name)
        if span is None and (start is None or end is None):
            raise InvalidInput(
                "nothing moved there yet", "Bring in movement, or give --from and --to.", map_name
            )
        first = start or span[0]  # type: ignore[index]
        last = end or to_datetime(to_us(span[1]) + 1)  # type: ignore[index]
        require_order(first, last)
        found = ways(connection, map_name, first, last, tracks)
    if not found:
        raise InvalidInput("no track was there then", "Ask for another time or other tracks.", map_name)
    with written(file) as draft:
        draw_trajectories(shown, found, f"{map_name}, {clock(first)} to {clock(last)} UTC", draft)
    say(f"{counted(len(found), 'track')} drawn to {file}.")


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
    from semap.picture.timeline import draw_timeline  # noqa: PLC0415
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.event.event_log import Selection, lanes, span_of  # noqa: PLC0415

    _require_picture(file)
    require_order(start, end)
    with (
        database(dsn, map_name) as opened,
        one_transaction(opened, "semap_read", application="semap plot") as connection,
    ):
        span = span_of(connection, map_name)
        if span is None and (start is None or end is None):
            raise InvalidInput(
                "the map has no events yet", "Give --from and --to, or import tracks.", map_name
            )
        first, last = start or span[0], end or span[1]  # type: ignore[index]
        if last <= first:
            raise InvalidInput("it ends before it begins", "Give the earlier time first.", "--from, --to")
        margin = (last - first) * MARGIN
        first, last = (start and first) or first - margin, (end and last) or last + margin
        found = lanes(connection, Selection(map_name, first, last, rules))
    with written(file) as draft:
        draw_timeline(found, first, last, f"{map_name}: rooms, doors and events", draft)
    say(f"{counted(len(found), 'lane')} drawn to {file}.")


def _require_picture(file: Path) -> None:
    from semap.picture.figure import FORMATS  # noqa: PLC0415

    if file.suffix.lower() not in FORMATS:
        raise InvalidInput("there is no such picture", f"The formats are {', '.join(FORMATS)}.", file.name)
