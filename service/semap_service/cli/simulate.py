"""semap simulate"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from semap_service.cli.output import counted, print_json, say
from semap_service.cli.session import AsJson

OFFICE = """
Write a recording of a made-up office, with its map and the ground truth.

A robot stands in the hallway and watches the doors with a camera and a laser; people open doors, enter rooms
and leave them. FOLDER then holds recording.mcap (ROS 2), map/map.yaml and labels.json, which says when each
person was in which room and each door moved. The same options give the same recording.

Bring it in: semap map import FOLDER/map; semap ingest recording FOLDER/recording.mcap --map office
"""


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Recordings of a made-up world, whose truth is known.")
    app.command("office", help=OFFICE)(office)
    app.callback()(_nothing)
    return app


def office(
    folder: Annotated[Path, typer.Argument(help="A new folder for the recording.")],
    seed: Annotated[int, typer.Option(help="Another seed: other people, rooms, order and times.")] = 1,
    people: Annotated[
        int, typer.Option(help="1 to 20; six at most change rooms, the others stroll about and hide them.")
    ] = 5,
    duration: Annotated[
        float, typer.Option(help="Seconds; less than 93 have fewer changes of rooms.", metavar="SECONDS")
    ] = 93.0,
    gap: Annotated[
        list[str] | None,
        typer.Option(help="A silent sensor: camera:20:5 is from second 20 on for 5 s; may be repeated."),
    ] = None,
    cloud: Annotated[bool, typer.Option("--cloud", help="Add the points of a 3D laser, 160 MB.")] = False,
    no_camera: Annotated[
        bool, typer.Option("--no-camera", help="Leave out the images: done in seconds, and 6 MB small.")
    ] = False,
    wall_cameras: Annotated[
        int, typer.Option(help="So many cameras on walls that find boxes of persons by themselves, up to 6.")
    ] = 0,
    wall_lasers: Annotated[int, typer.Option(help="So many lasers on walls, up to 2.")] = 0,
    as_json: AsJson = False,
) -> None:
    from semap_ingest.simulation.labels import read_labels  # noqa: PLC0415
    from semap_ingest.simulation.office import write_office  # noqa: PLC0415
    from semap_ingest.simulation.settings import Gap, OfficeSettings  # noqa: PLC0415

    from semap_service.cli.progress import progress_bar  # noqa: PLC0415

    settings = OfficeSettings(
        seed=seed,
        people=people,
        duration_s=duration,
        camera=not no_camera,
        cloud=cloud,
        gaps=tuple(Gap.parse(text) for text in gap or ()),
        wall_cameras=wall_cameras,
        wall_lasers=wall_lasers,
    )
    with progress_bar("tenths of a second", quiet=as_json) as advance:
        paths = write_office(folder, settings, advance)
    labels = read_labels(paths.labels)
    kinds: Counter[str] = Counter(each.kind for each in labels.transitions)
    kinds.update(each.kind for each in labels.doors)
    if as_json:
        print_json(
            {
                "recording": str(paths.recording),
                "labels": str(paths.labels),
                "map": str(paths.map),
                "transitions": len(labels.transitions),
                "openings": kinds["opening"],
                "closings": kinds["closing"],
                "relations": len(labels.relations),
            }
        )
        return
    say(f"{duration:g} s with {counted(people, 'person')} written to {paths.recording}:")
    say(
        f"{counted(kinds['entered'], 'entering')} and {counted(kinds['left'], 'leaving')} of rooms,"
        f" {counted(kinds['opening'], 'opening')} and {counted(kinds['closing'], 'closing')} of doors."
    )


def _nothing() -> None:
    """Keep the name of the command even while there is but one."""
