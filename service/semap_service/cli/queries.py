"""semap query"""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from semap_service.cli.output import print_rows
from semap_service.cli.session import AsJson, Dsn, database

MapOption = Annotated[str | None, typer.Option("--map", help="Only those of this map.")]
QueryId = Annotated[
    int, typer.Argument(metavar="ID", help="Number of the query, as `semap query list` shows it.")
]


def commands() -> typer.Typer:
    app = typer.Typer(
        no_args_is_help=True,
        help="Continuous queries: which relations between tracks and instances are kept true.",
    )
    app.command("list")(list_all)
    app.command("add")(add)
    app.command("enable")(enable)
    app.command("disable")(disable)
    app.command("delete")(delete)
    app.command("now")(now)
    return app


def list_all(map_name: MapOption = None, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the continuous queries."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.queries import list_queries  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        rows = [asdict(found) for found in list_queries(connection, map_name=map_name, limit=1000)]
    print_rows(rows, as_json, "No queries. A map brings one with it: semap map import BUILDING.geojson")


def add(
    name: Annotated[str, typer.Argument(help="A name for the query.")],
    map_name: Annotated[str, typer.Option("--map", help="The map it watches.")],
    concept: Annotated[
        str, typer.Option(help="Which instances may contain a track, with the concepts below.")
    ],
    dsn: Dsn = None,
) -> None:
    """Keep true which tracks are inside which instances of a concept, from now on.

    Tracks that are inside now are noted at once.
    """
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.queries import add_query  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        made = add_query(connection, map_name, name, concept)
    typer.echo(f"Query {made.query_id} made: {name}. Let a rule listen to it: semap rule add")


def enable(query_id: QueryId, dsn: Dsn = None) -> None:
    """Keep its relations true again, from the present state on."""
    _enable(query_id, True, dsn)


def disable(query_id: QueryId, dsn: Dsn = None) -> None:
    """Let its relations end, and keep none."""
    _enable(query_id, False, dsn)


def _enable(query_id: int, enabled: bool, dsn: str | None) -> None:
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.queries import enable_query  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        done = enable_query(connection, query_id, enabled)
    typer.echo(f"Query {done.name} is {'enabled' if done.enabled else 'disabled'}.")


def delete(query_id: QueryId, dsn: Dsn = None) -> None:
    """Delete a query that no rule listens to; its relations end."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.queries import delete_query  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        delete_query(connection, query_id)
    typer.echo(f"Query {query_id} deleted.")


def now(
    map_name: MapOption = None,
    track: Annotated[str | None, typer.Option(help="Only this track.")] = None,
    room: Annotated[str | None, typer.Option(help="Only this instance.")] = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show which track is in which instance now, and since when."""
    from semap.store.database import connect, translated  # noqa: PLC0415

    with database(dsn) as opened, connect(opened, "semap_read") as connection, translated():
        cursor = connection.execute(
            "select map, query, track, instance, since from semap.relation_now"
            " where (%(map)s::text is null or map = %(map)s)"
            " and (%(track)s::text is null or track = %(track)s)"
            " and (%(room)s::text is null or instance = %(room)s) order by map, instance, track",
            {"map": map_name, "track": track, "room": room},
        )
        columns = [column.name for column in cursor.description or ()]
        rows = [dict(zip(columns, row, strict=True)) for row in cursor.fetchall()]
    print_rows(rows, as_json, "No relation holds now.")
