"""semap source"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated

import typer

from semap_service.cli.output import print_rows
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from semap.store.motion.sources import Source

EVERY = "none"


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Sources of states, and their settings.")
    app.command("list")(list_all)
    app.command("set")(change)
    return app


def list_all(
    map_name: Annotated[str | None, typer.Option("--map", help="Only those of this map.")] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """List the sources with their settings, and their numbers of outliers and late states."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap.store.motion.sources import list_sources  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = list_sources(connection, map_name=map_name, limit=1000)
    print_rows([_row(each) for each in found], as_json, "No sources. Bring in movement: semap ingest --help")


def change(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the source.")],
    map_name: Annotated[str, typer.Option("--map", help="Its map.")],
    lateness: Annotated[
        float | None,
        typer.Option(
            help="How long rules wait for rows of it that come after others of later stamps [s].", min=0
        ),
    ] = None,
    jump: Annotated[
        str | None,
        typer.Option(
            help="Outlier gate: a position further from the last one than this [m], plus --jump-speed, is"
            " held back until the next one agrees with it; none: no gate."
        ),
    ] = None,
    jump_speed: Annotated[
        float | None,
        typer.Option(help="Added to --jump for each second since [m/s].", min=0),
    ] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Change the outlier gate and the lateness of a source, from its next states on.

    semap source set lidar --map office --jump 5 --jump-speed 10 --lateness 2
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.motion.sources import change_source, find_source  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_api") as connection:
        known = find_source(connection, map_name, name)
        was = known.settings
        settings = replace(
            was,
            lateness_s=was.lateness_s if lateness is None else lateness,
            jump_m=was.jump_m if jump is None else _metres(jump),
            jump_mps=was.jump_mps if jump_speed is None else jump_speed,
        )
        done = change_source(connection, known.source_id, settings)
    print_rows([_row(done)], as_json, "")


def _metres(said: str) -> float | None:
    """raises InvalidInput"""
    from semap.errors import InvalidInput  # noqa: PLC0415

    if said.strip().lower() == EVERY:
        return None
    try:
        return float(said)
    except ValueError as error:
        raise InvalidInput(f"{said!r} is no length", "Give metres, or: none", "--jump") from error


def _row(source: Source) -> dict[str, object]:
    return {
        "id": source.source_id,
        "map": source.map,
        "source": source.name,
        **asdict(source.settings),
        "late_states": source.late_states,
        "outliers": source.outliers,
        "complete_through": source.complete_through,
    }
