"""semap rig"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from semap_service.cli.output import print_json, print_rows, say
from semap_service.cli.session import AsJson


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Which sensors there are, and where they are fixed.")
    app.command("check")(check)
    app.callback()(_nothing)
    return app


def check(
    file: Annotated[
        Path | None,
        typer.Argument(
            help="ROS 1 bag, ROS 2 folder (sqlite3 or MCAP), or MCAP file; none to try a rig of files."
        ),
    ] = None,
    rig: Annotated[Path | None, typer.Option(help="A rig to try on the recording.")] = None,
    as_json: AsJson = False,
) -> None:
    """Propose a rig for a recording, as YAML; or try one, --rig FILE.

    The proposal has all sensors that the recording holds, how often they speak, and what is missing: put it
    into a file, fill in what it asks for, and try it. If the recording lacks something for a rig, the exit
    status is 1.
    """
    from dataclasses import asdict  # noqa: PLC0415

    from semap_ingest.pipeline.rig import read_rig  # noqa: PLC0415
    from semap_ingest.pipeline.rig_check import propose, rig_text, sights  # noqa: PLC0415
    from semap_ingest.pipeline.rig_sensors import box_files_of, topics_of  # noqa: PLC0415
    from semap_ingest.recording.gathered import Gathered  # noqa: PLC0415
    from semap_ingest.recording.reading import Recording  # noqa: PLC0415

    from semap.errors import InvalidInput  # noqa: PLC0415

    with ExitStack() as stack:
        recording = None if file is None else stack.enter_context(Recording(file))
        if rig is not None:
            read = read_rig(rig)
            gathered = Gathered(recording, box_files_of(read))
            topics_of(read, gathered.topics)
            seen = sights(gathered, read)
        elif recording is not None:
            proposed, notes = propose(recording)
            seen = sights(recording, proposed)
        else:
            raise InvalidInput("there is nothing to check", "Name a recording, or a rig: --rig FILE.")
    if rig is None:
        if as_json:
            print_json({"sensors": [asdict(each) for each in seen], "notes": notes})
        else:
            say(rig_text(proposed, seen, notes).rstrip())
        return
    print_rows([asdict(each) for each in seen], as_json, "")
    if any(each.trouble for each in seen):
        raise typer.Exit(1)


def _nothing() -> None:
    """Keep the name of the command even while there is but one."""
