"""semap track"""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from semap_service.cli.output import clock, counted, print_json_line, print_rows, say
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from semap.store.motion.track_amendments import TrackAmendment

PAGE = 500
WAKE_S = 1.0
NO_CONCEPT = "none"

MapOption = Annotated[str | None, typer.Option("--map", help="Only those of this map.")]
Number = Annotated[int, typer.Option(help="Only those after this number.", min=0)]


def commands() -> typer.Typer:
    app = typer.Typer(no_args_is_help=True, help="Tracks, and corrections by their trackers.")
    app.command("list")(list_all)
    app.command("set")(describe)
    app.command("amendments")(amendments)
    return app


def list_all(
    map_name: MapOption = None,
    every: Annotated[bool, typer.Option("--all", help="Also those that have ended.")] = False,
    after: Number = 0,
    limit: Annotated[int, typer.Option(help="At most so many.", min=1, max=1000)] = 1000,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """List the live tracks, with position and extent."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap.store.motion.tracks import count_ended, list_tracks  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        if map_name is not None:
            get_map(connection, map_name)
        found = list_tracks(
            connection, map_name=map_name, live=None if every else True, after=after, limit=limit
        )
        ended = 0 if found or every else count_ended(connection, map_name=map_name, after=after)
    shown = ("stamp", "x_m", "y_m", "z_m", "std_m", "heading_rad", "speed_mps", "length_m", "width_m")
    rows = [
        {
            "id": each.track_id,
            "map": each.map,
            "source": each.source,
            "track": each.name,
            "concept": each.concept,
            **{name: _short(getattr(each.state, name, None)) for name in shown},
        }
        for each in found
    ]
    none_lives = f"No track lives now; {counted(ended, 'track')} ended. To list them: semap track list --all"
    print_rows(rows, as_json, none_lives if ended else "No tracks. Bring in movement: semap ingest --help")


def describe(
    number: Annotated[
        int, typer.Argument(metavar="ID", help="Number of the track, as `semap track list` shows it.")
    ],
    concept: Annotated[str | None, typer.Option(help="Its concept; none: unknown.")] = None,
    attributes: Annotated[
        str | None, typer.Option(help='Its attributes, as JSON: \'{"kind": "forklift"}\'.')
    ] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Set the concept and attributes of a track. Queries select it by them from now on."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.motion.tracks import describe_track, get_track  # noqa: PLC0415
    from semap_service.cli.written_attributes import read_attributes  # noqa: PLC0415

    said = read_attributes(attributes)
    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        known = get_track(connection, number)
        kind = known.concept if concept is None else None if concept == NO_CONCEPT else concept
        done = describe_track(connection, number, kind, known.attributes if said is None else said)
    row = {"id": number, "track": done.name, "concept": done.concept, "attributes": dict(done.attributes)}
    print_rows([row], as_json, "")


def amendments(
    map_name: MapOption = None,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Continue with new ones.")] = False,
    after: Number = 0,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show tracks that turned out to be one person, or that swapped persons, oldest first."""
    from semap.store.database.connection import listen, one_session, wait_for_notice  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap.store.motion.track_amendments import list_track_amendments  # noqa: PLC0415

    with (
        database(dsn, map_name) as opened,
        one_session(opened, "semap_read", application="semap track") as engine,
        listen(opened, "semap_amendment", "semap_read", application="semap track") as listening,
    ):
        if map_name is not None:
            with engine.begin() as connection:
                get_map(connection, map_name)
        shown = 0
        while True:
            with engine.begin() as connection:
                page = list_track_amendments(connection, map_name=map_name, after=after, limit=PAGE)
            for each in page:
                print_json_line(asdict(each)) if as_json else say(sentence(each))
                after = each.track_amendment_id
            shown += len(page)
            if len(page) == PAGE:
                continue
            if not follow:
                break
            wait_for_notice(listening, WAKE_S)
        if not shown and not as_json:
            say("No amendments. Trackers of `semap ingest recording` make them.", err=True)


def sentence(amendment: TrackAmendment) -> str:
    """An amendment as a line for people."""
    said = {
        "merged": f"{amendment.track} is {amendment.other_track} since {clock(amendment.since)}",
        "switched": f"{amendment.track} and {amendment.other_track} had changed places since"
        f" {clock(amendment.since)}",
    }[amendment.kind]
    return f"{amendment.track_amendment_id:>6}  {clock(amendment.found)}  {said}"


def _short(value: object) -> object:
    return round(value, 3) if isinstance(value, float) else value
