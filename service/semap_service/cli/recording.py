"""semap recording"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from semap_service.cli.output import print_json, say
from semap_service.cli.session import AsJson


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="What recordings of sensors hold.")
    app.command("info")(info)
    app.callback()(_nothing)
    return app


def info(
    file: Annotated[Path, typer.Argument(help="ROS 1 bag, ROS 2 folder (sqlite3 or MCAP), or MCAP file.")],
    as_json: AsJson = False,
) -> None:
    """List the topics of a recording, and which part each can play for `semap ingest recording`."""
    from semap_ingest.pipeline.topics import CHOSEN_BY_NAME_ONLY, PARTS  # noqa: PLC0415
    from semap_ingest.recording.reading import Recording  # noqa: PLC0415

    from semap.timeline.stamp import to_datetime  # noqa: PLC0415

    with Recording(file) as recording:
        start, end = to_datetime(recording.start_us), to_datetime(recording.end_us)
        rows = [
            {
                "topic": topic.name,
                "type": topic.type,
                "messages": topic.count,
                "part": next(
                    (part for part, types in PARTS.items() if topic.type.rpartition("/")[2] in types), None
                ),
            }
            for topic in recording.topics
        ]
    if as_json:
        print_json({"start": start.isoformat(), "end": end.isoformat(), "topics": rows})
        return
    say(f"{start:%Y-%m-%d %H:%M:%S} to {end:%Y-%m-%d %H:%M:%S}, {(end - start).total_seconds():.1f} s")
    width = max((len(str(row["topic"])) for row in rows), default=0)
    for row in rows:
        part = f"({row['part']})" if row["part"] in CHOSEN_BY_NAME_ONLY else row["part"] or "-"
        say(f"  {row['topic']:<{width}}  {row['messages']:>8}  {part:<12}  {row['type']}")
    if any(row["part"] in CHOSEN_BY_NAME_ONLY for row in rows):
        say("  (in brackets: only where it is named, as in --topic poses=TOPIC)")


def _nothing() -> None:
    """Keep the name of the command even while there is but one."""
