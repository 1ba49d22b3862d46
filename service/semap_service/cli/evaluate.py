"""semap evaluate"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from semap_service.cli.output import say

PARTS = ("detection", "seeds", "delays", "throughput", "tracking", "repeat", "walls", "scans")
PEOPLE = (1, 5, 10, 20)


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="How well it works, on recordings whose truth is known.")
    app.command("office")(office)
    app.callback()(_nothing)
    return app


def office(
    part: Annotated[
        list[str] | None,
        typer.Argument(help=f"What to evaluate: {', '.join(PARTS)}. [default: detection, throughput]"),
    ] = None,
    folder: Annotated[
        Path, typer.Option("--out", help="Folder for the figures (JSON) and pictures (PNG).")
    ] = Path("evaluation"),
    seeds: Annotated[int, typer.Option(help="So many other seeds.", min=1)] = 20,
    plays: Annotated[
        int,
        typer.Option(
            help="So many plays in real time for the delays, at each of two rates of images.", min=1
        ),
    ] = 25,
    data: Annotated[
        Path | None, typer.Option(help="Folder of the real data sets, for `scans` (laser_people/).")
    ] = None,
) -> None:
    """Play recordings of the simulated office through all of semap, and compare events with labels.

    The office is a made-up floor with people who change rooms and open doors; its recording (camera, laser,
    tf) is made at first use and kept in the cache. PostGIS, the rule worker and all else run for it alone.
    One play takes half a minute, in real time (delays, repeat) one and a half.
    """
    from semap_service.cli.perception_extra import require_perception  # noqa: PLC0415

    chosen = part or ["detection", "throughput"]
    _require(chosen, folder, data)
    require_perception("playing recordings")

    from semap_service.cli.progress import progress_bar  # noqa: PLC0415
    from semap_service.evaluation.office import Stage, evaluate  # noqa: PLC0415
    from semap_service.evaluation.report import table, write  # noqa: PLC0415
    from semap_service.processes.supervisor import Supervisor  # noqa: PLC0415
    from semap_service.processes.temporary_server import temporary_server  # noqa: PLC0415

    failed = []
    with temporary_server("evaluate") as dsn, Supervisor(dsn) as supervisor:
        supervisor.start("work")
        for name in chosen:
            say(f"{name} ...")
            with progress_bar("tenths of a second of the recording") as advance:
                stage = Stage(dsn, lambda line: say(line, err=True), advance)
                report = evaluate(stage, name, seeds=seeds, plays=plays, people=PEOPLE, data=data)
            say(f"\n{name} (aim: {report.aim}): {'holds' if report.holds else 'DOES NOT HOLD'}")
            say(table(report.rows))
            for line in report.details:
                say(f"  {line}")
            written = write(report, folder)
            say(f"  written: {', '.join(str(path) for path in written)}\n")
            if not report.holds:
                failed.append(name)
    if failed:
        say(f"Short of the aim: {', '.join(failed)}.", err=True)
        raise typer.Exit(1)


def _require(parts: list[str], folder: Path, data: Path | None) -> None:
    """raises InvalidInput, before anything is measured, where a part cannot be or its report not be kept"""
    from semap.errors import InvalidInput  # noqa: PLC0415

    for each in parts:
        if each not in PARTS:
            raise InvalidInput(f"there is no part {each}", f"Choose from {', '.join(PARTS)}.")
    if "scans" in parts and not (data is not None and (data / "laser_people").is_dir()):
        raise InvalidInput(
            "scans needs the real data sets", "Name their folder, with laser_people/ in it: --data FOLDER"
        )
    if find_spec("matplotlib") is None:
        raise InvalidInput("drawing needs matplotlib", "pip install 'semap[plot]'")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidInput(
            f"{folder} cannot be made: {error.strerror}", "Choose another folder: --out FOLDER"
        ) from error


def _nothing() -> None:
    """Keep the name of the command even while there is but one."""
