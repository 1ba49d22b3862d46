"""semap map history, undo"""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from semap_service.cli.output import clock, counted, print_json, print_rows, say
from semap_service.cli.session import AsJson, Dsn, MapName, database, signed_edit

ChangeId = Annotated[
    int, typer.Argument(metavar="CHANGE", help="Number of the change, as `semap map history` shows it.")
]


def history(
    map_name: MapName,
    change: Annotated[int | None, typer.Option("--change", help="Show the rows of this change.")] = None,
    limit: Annotated[int, typer.Option(help="Show at most so many.", min=1, max=1000)] = 20,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show the change sets of a map with author and time, the newest first."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map import history as kept  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        if change is not None:
            kept.get_change_set(connection, change)
            rows = [asdict(each) for each in kept.rows_of(connection, change)]
        else:
            rows = [asdict(each) for each in kept.list_change_sets(connection, map_name, limit=limit)]
    if not as_json and change is None:
        rows = [
            {"change": row["change_set_id"], "made at": clock(row["made_at"]), "by": row["author"],
             "rows": row["rows"], "undoes": row["undoes"], "message": row["message"]}
            for row in rows
        ]  # fmt: skip
    print_rows(rows, as_json, f"Nothing was changed on map {map_name}.")


def undo(change: ChangeId, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """Undo a change set of a map completely. The undo is a change set too, and can be undone.

    Refused where something of it was changed since: undo the later change first.
    """
    from semap.store.map import history as kept  # noqa: PLC0415

    with database(dsn) as opened, signed_edit(opened, f"semap map undo {change}") as connection:
        made = kept.undo(connection, change)
    if as_json:
        print_json(asdict(made))
        return
    say(f"Change {change} is undone, by change {made.change_set_id} ({counted(made.rows, 'row')}).")
