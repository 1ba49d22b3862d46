"""semap map frames, transform"""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from typing import Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.output import print_json, print_rows
from semap_service.cli.session import AsJson, Dsn, MapName, database


def frames(map_name: MapName, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the frames of a map, with parents and poses."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.frames import list_frames  # noqa: PLC0415

    rows: list[dict[str, object]] = []
    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        after = 0
        while page := list_frames(connection, map_name, after=after, limit=1000):
            for found in page:
                pose = (
                    {} if found.pose is None else {key: round(v, 6) for key, v in asdict(found.pose).items()}
                )
                rows.append(
                    asdict(found)
                    if as_json
                    else {"id": found.frame_id, "name": found.name, "parent": found.parent, **pose,
                          "static": found.is_static}
                )  # fmt: skip
            after = page[-1].frame_id
    print_rows(rows, as_json, f"Map {map_name} has no frames.")


def transform(
    map_name: MapName,
    target: Annotated[str, typer.Argument(metavar="TARGET", help="Name of the frame of the result.")],
    source: Annotated[str, typer.Argument(metavar="SOURCE", help="Name of the frame whose pose is shown.")],
    at: Annotated[
        str | None, typer.Option(help="At this time (ISO 8601 with an offset, such as Z). [default: now]")
    ] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show target_T_source: the pose of one frame in another, now or at a past time.

    semap map transform office map Table1 --at 2026-01-31T12:00:00Z
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.frames import frame_named  # noqa: PLC0415
    from semap.store.map.frames import transform as between  # noqa: PLC0415

    stamp = None if at is None else _stamp(at)
    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        target_id = frame_named(connection, map_name, target).frame_id
        source_id = frame_named(connection, map_name, source).frame_id
        pose = asdict(between(connection, target_id, source_id, stamp))
    if as_json:
        print_json(pose)
        return
    print_rows([{key: f"{value:.6f}" for key, value in pose.items()}], as_json, "")


def _stamp(text: str) -> datetime:
    try:
        stamp = datetime.fromisoformat(text)
    except ValueError as error:
        raise InvalidInput(
            f"{text!r} is no time", "Give ISO 8601, such as 2026-01-31T12:00:00Z.", "--at"
        ) from error
    if stamp.tzinfo is None:
        raise InvalidInput(f"{text} has no time zone", "Give it with its offset, such as Z.", "--at")
    return stamp
