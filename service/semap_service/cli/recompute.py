"""semap recompute"""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from typing import Annotated

import typer

from semap_service.cli.output import clock, print_json, say
from semap_service.cli.session import AsJson, Dsn, database
from semap_service.cli.stamp import read_stamp

SHOWN = 50


def recompute(
    start: Annotated[
        datetime,
        typer.Argument(parser=read_stamp, metavar="FROM", help="From then on, such as 2026-01-31T12:00:00Z."),
    ],
    end: Annotated[datetime, typer.Argument(parser=read_stamp, metavar="TO", help="Before then.")],
    map_name: Annotated[str, typer.Option("--map", help="The map of the events.")],
    rules: Annotated[
        list[str] | None, typer.Option("--rule", help="Only this rule; may be given again. [default: all]")
    ] = None,
    same_s: Annotated[
        float,
        typer.Option(
            "--same", help="Stamps that differ by at most this are the same [s].", min=0, max=86_400
        ),
    ] = 0.5,
    reach_s: Annotated[
        float,
        typer.Option(
            "--reach", help="Up to this an event is amended, beyond it another one [s].", min=0, max=86_400
        ),
    ] = 3.0,
    acceleration: Annotated[
        float,
        typer.Option(
            help="Process noise of the acceleration of tracks: density [m^2/s^3].", min=1e-6, max=1e6
        ),
    ] = 0.5,
    std_m: Annotated[
        float, typer.Option("--std", help="Of a position of a state without one [m].", min=1e-3, max=1e3)
    ] = 0.1,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the changes without making them.")] = False,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Recompute relations and rules over stored states, and give each event a verdict.

    Tracks are smoothed over their whole length, and transition times are interpolated, on the map as it is
    now. Each event of the time span is then confirmed, amended (with a link to the corrected event) or
    retracted; missing events are added. Nothing is deleted, and a repetition gives the same result.
    """
    from semap.batch.recompute import Plan, recompute  # noqa: PLC0415
    from semap.batch.smoothing import Motion  # noqa: PLC0415
    from semap.errors import InvalidInput  # noqa: PLC0415

    if reach_s < same_s:
        raise InvalidInput("--reach is less than --same", "Give it at least as much.", "--reach")
    plan = Plan(map_name, start, end, rules, Motion(acceleration, std_m), same_s, reach_s)
    with database(dsn, map_name) as opened:
        outcome = recompute(opened, plan, _silent if as_json else _say, dry_run=dry_run)
    counts = outcome.counts()
    if as_json:
        changed = [asdict(each) for each in outcome.changed]
        lost = {name: given_up.as_json() for name, given_up in outcome.given_up.items()}
        print_json({"run": outcome.run_id, **counts, "changed": changed, "given_up": lost})
        return
    for each in outcome.changed[:SHOWN]:
        moved = f" -> {clock(each.by_stamp)}" if each.by_stamp is not None else ""
        about = " ".join(part for part in (each.track, each.type, each.instance) if part)
        say(f"{each.verdict:>10}  {clock(each.stamp)}{moved}  {about}")
    if len(outcome.changed) > SHOWN:
        say(f"... and {len(outcome.changed) - SHOWN} more; --json shows all.")
    for name, given_up in outcome.given_up.items():
        say(f"Rule {name}: {given_up.as_text()}", err=True)
    said = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    say(f"{'Would be' if dry_run else f'Run {outcome.run_id}:'} {said}.")


def _say(what: str) -> None:
    say(f"{what} ...", err=True)


def _silent(what: str) -> None:
    pass
