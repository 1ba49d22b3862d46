"""semap relations"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from semap.errors import InvalidInput
from semap_service.cli.output import print_rows
from semap_service.cli.session import AsJson, Dsn, database
from semap_service.cli.stamp import AsOf, From, To, require_order

if TYPE_CHECKING:
    from semap.store.relation.relation_spans import Chosen


def relations(
    map_name: Annotated[str | None, typer.Option("--map", help="Only those of this map.")] = None,
    query: Annotated[str | None, typer.Option(help="Only those by the query of this name.")] = None,
    track: Annotated[str | None, typer.Option(help="Only those of this track, on either side.")] = None,
    room: Annotated[str | None, typer.Option(help="Only those of this instance, on either side.")] = None,
    as_of: AsOf = None,
    start: From = None,
    end: To = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show relations: current ones, those as of a time, or those within a time span.

    semap relations --map office --as-of 2026-01-31T12:00:00Z
    """
    from semap.store.relation.relation_spans import Chosen  # noqa: PLC0415

    require_order(start, end)
    if as_of is not None and (start is not None or end is not None):
        raise InvalidInput("one moment, or the time between two", "Leave one out.", "--as-of, --from, --to")
    show(Chosen(map_name, query, track, room, as_of, start, end), as_json, dsn)


def show(chosen: Chosen, as_json: bool, dsn: str | None) -> None:
    """Print what holds or held, with how long it did."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.relation.relation_spans import list_spans  # noqa: PLC0415

    with (
        database(dsn, chosen.map) as opened,
        one_transaction(opened, "semap_read") as connection,
    ):
        rows = [dict(row) for row in list_spans(connection, chosen)]
    print_rows(rows, as_json, "No relation holds now." if chosen.is_now else "No relation held then.")
