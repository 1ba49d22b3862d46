"""semap query"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semap.model.continuous_query import (
    DEFAULT_DEBOUNCE,
    BetweenSamples,
    Certainty,
    Debounce,
    Declaration,
    Side,
)
from semap_service.cli.output import clock, print_json_line, print_rows
from semap_service.cli.session import AsJson, Dsn, database

if TYPE_CHECKING:
    from semap.worker.query_watch import Delta

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
    app.command("watch")(watch)
    return app


def list_all(map_name: MapOption = None, as_json: AsJson = False, dsn: Dsn = None) -> None:
    """List the continuous queries."""
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.queries import list_queries  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_read") as connection:
        found = list_queries(connection, map_name=map_name, limit=1000)
    rows = [
        {
            "query_id": each.query_id,
            "map": each.map,
            "enabled": each.enabled,
            **_row(each.declaration, as_json),
        }
        for each in found
    ]
    print_rows(rows, as_json, "No queries. A map brings one with it: semap map import BUILDING.geojson")


def _row(asked: Declaration, whole: bool) -> dict[str, Any]:
    """What a query asks: all of it, or what fits into a line."""
    if whole:
        return asdict(asked)
    extra = [
        f"{asked.distance_m:g} m" if asked.distance_m is not None else "",
        "some tracks" if asked.subject != Side("track") else "",
        "debounced" if asked.debounce != Debounce() else "",
        "by probability" if asked.certainty is not None else "",
        "between samples" if asked.between_samples is not None else "",
    ]
    return {
        "name": asked.name,
        "predicate": asked.predicate,
        "concept": asked.object.concept or "any",
        "more": ", ".join(filter(None, extra)),
    }


def add(
    name: Annotated[str, typer.Argument(help="A name for the query.")],
    map_name: Annotated[str, typer.Option("--map", help="The map it watches.")],
    concept: Annotated[
        str | None, typer.Option(help="Which instances, with the concepts below. [default: any]")
    ] = None,
    predicate: Annotated[
        str,
        typer.Option(
            help="How they relate to a track: contains, covers, within_distance, on, in_front_of, behind,"
            " left_of, right_of."
        ),
    ] = "contains",
    distance: Annotated[
        float | None, typer.Option(help="Of within_distance; how far a direction reaches [m].")
    ] = None,
    where: Annotated[
        str | None,
        typer.Option(help='Only instances of which this is true, in CQL2: "attributes.floor = 2".'),
    ] = None,
    track_where: Annotated[
        str | None, typer.Option(help="Only tracks of which this is true: \"source = 'camera'\".")
    ] = None,
    track_concept: Annotated[str | None, typer.Option(help="Only tracks of this concept.")] = None,
    abstraction: Annotated[
        str, typer.Option(help="What of an instance is compared: Footprint, FootprintHull, Position2D ...")
    ] = "Footprint",
    flat: Annotated[bool, typer.Option("--flat", help="Heights do not count.")] = False,
    debounce: Annotated[
        bool,
        typer.Option("--debounce", help="Let flicker at the boundary not count: --margin 0.15, both ways."),
    ] = False,
    margin: Annotated[
        float | None, typer.Option(help="How far beyond the boundary counts as across, both ways [m].")
    ] = None,
    confirm: Annotated[
        float | None, typer.Option(help="How long it has to stay across, both ways [s of event time].")
    ] = None,
    probability: Annotated[
        float | None,
        typer.Option(
            help="Begin where it is so probable, end where the opposite is: 0.9.", min=0.5, max=0.999999
        ),
    ] = None,
    between_samples: Annotated[
        bool,
        typer.Option(
            "--between-samples",
            help="Take the way between two samples as a straight line: exact times, no room is missed.",
        ),
    ] = False,
    longest_gap: Annotated[float, typer.Option(help="No line over a longer pause than this [s].")] = 30.0,
    fastest: Annotated[float, typer.Option(help="No line that asks for a higher speed [m/s].")] = 30.0,
    sql: Annotated[
        str | None,
        typer.Option(help="Instead of the sides and the predicate: a SELECT over the views of semap_query."),
    ] = None,
    dsn: Dsn = None,
) -> None:
    """Keep a relation of tracks to instances true, from now on. What holds now is noted at once.

    semap query add near_door --map office --concept Door --predicate within_distance --distance 1
    """
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.queries import add_query, declaration_from_sql, read_condition  # noqa: PLC0415

    beside_m = margin if margin is not None else DEFAULT_DEBOUNCE.enter_margin_m if debounce else 0.0
    declaration = Declaration(
        name=name,
        predicate=predicate,  # type: ignore[arg-type]
        subject=Side(
            "track",
            track_concept,
            None,
            None if track_where is None else read_condition(track_where, "--track-where"),
        ),
        object=Side("instance", concept, None, None if where is None else read_condition(where, "--where")),
        distance_m=distance,
        abstraction=abstraction,
        dimensions=2 if flat else 3,
        debounce=Debounce(beside_m, beside_m, confirm or 0.0, confirm or 0.0),
        certainty=None if probability is None else Certainty(probability, 1 - probability),
        between_samples=BetweenSamples(longest_gap, fastest) if between_samples else None,
    )
    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        if sql is not None:
            in_sql = declaration_from_sql(connection, name, sql)
            declaration = replace(
                in_sql,
                debounce=declaration.debounce,
                certainty=declaration.certainty,
                between_samples=declaration.between_samples,
            )
        made = add_query(connection, map_name, declaration, sql=sql)
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


def watch(
    name: Annotated[str, typer.Argument(help="Name of the query.")],
    map_name: Annotated[str, typer.Option("--map", help="Its map.")],
    limit: Annotated[
        int | None, typer.Option(help="Stop after so many changes. [default: go on until Ctrl-C]", min=0)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, an object a line.")] = False,
    dsn: Dsn = None,
) -> None:
    """Show what holds now, and then each change as it is committed: none is missed, none comes twice.

    `=` holds, `+` began, `-` ended; when the boundary was crossed and, if that was later, when it was known.
    """
    from semap.store.database import one_transaction  # noqa: PLC0415
    from semap.store.queries import find_query  # noqa: PLC0415
    from semap.worker.query_watch import watch_query  # noqa: PLC0415

    with database(dsn) as opened:
        with one_transaction(opened, "semap_read") as connection:
            query = find_query(connection, map_name, name)
        changes = 0
        try:
            for delta in watch_query(opened, query.query_id):
                if limit is not None and changes >= limit and (delta is None or delta.kind is not None):
                    return
                if delta is None:
                    continue
                changes += delta.kind is not None
                print_json_line(asdict(delta)) if as_json else typer.echo(_line(delta))
        except KeyboardInterrupt:
            return


def _line(delta: Delta) -> str:
    sign = {None: "=", "began": "+", "ended": "-"}[delta.kind]
    at, known = clock(delta.at), ""
    if delta.known is not None and delta.known != delta.at:
        known = f"  (known {clock(delta.known)})"
    cause = "" if delta.cause in (None, "moved") else f"  {delta.cause}"
    return f"{sign} {at}  {delta.track}  {delta.instance}{cause}{known}"
