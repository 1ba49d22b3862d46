"""semap query"""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from semap.model.continuous_query import Debounce, Declaration, Side
from semap_service.cli import query_options as options
from semap_service.cli import relations
from semap_service.cli.output import clock, print_json_line, print_rows, say
from semap_service.cli.session import AsJson, Dsn, database
from semap_service.cli.stamp import AsOf

if TYPE_CHECKING:
    from semap.worker.query_watch import Delta

MapOption = Annotated[str | None, typer.Option("--map", help="Only those of this map.")]
QueryId = Annotated[
    int, typer.Argument(metavar="ID", help="Number of the query, as `semap query list` shows it.")
]


def commands() -> typer.Typer:
    app = typer.Typer(
        no_args_is_help=True,
        help="Continuous queries: which relations of tracks and instances are kept true.",
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
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.map.maps import get_map  # noqa: PLC0415
    from semap.store.relation.queries import list_queries  # noqa: PLC0415

    with database(dsn, map_name) as opened, one_transaction(opened, "semap_read") as connection:
        if map_name is not None:
            get_map(connection, map_name)
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
        f"{asked.count} nearest" if asked.count is not None else "",
        f"{asked.distance_m:g} m" if asked.distance_m is not None else "",
        f"{math.degrees(asked.angle_rad):g} degrees" if asked.angle_rad is not None else "",
        f"{asked.speed_mps:g} m/s" if asked.speed_mps is not None else "",
        (asked.direction or "").replace("_", " "),
        "" if asked.subject == Side(asked.subject.kind) else f"some {asked.subject.kind}s",
        "debounced" if asked.debounce != Debounce() else "",
        "by probability" if asked.certainty is not None else "",
        "between samples" if asked.between_samples is not None else "",
        "follows amendments" if asked.follows_amendments else "",
    ]
    return {
        "name": asked.name,
        "subject": asked.subject.concept or asked.subject.kind,
        "predicate": asked.predicate,
        "object": asked.object.concept or asked.object.kind,
        "more": ", ".join(filter(None, extra)),
    }


def add(
    name: Annotated[str, typer.Argument(help="A name for the query.")],
    map_name: Annotated[str, typer.Option("--map", help="The map of the query.")],
    predicate: options.Predicate = "contains",
    concept: options.Concept = None,
    where: options.Where = None,
    object_kind: options.ObjectKind = "instance",
    subject_concept: options.SubjectConcept = None,
    subject_where: options.SubjectWhere = None,
    subject_kind: options.SubjectKind = "track",
    distance: options.Distance = None,
    count: options.Count = None,
    angle: options.Angle = None,
    speed: options.Speed = None,
    direction: options.Direction = None,
    abstraction: options.Abstraction = "Footprint",
    flat: options.Flat = False,
    debounce: options.Debounced = False,
    margin: options.Margin = None,
    confirm: options.Confirm = None,
    probability: options.Probability = None,
    between_samples: options.Between = False,
    longest_gap: options.LongestGap = 30.0,
    fastest: options.Fastest = 30.0,
    follows_amendments: options.FollowsAmendments = False,
    sql: options.Sql = None,
    dsn: Dsn = None,
) -> None:
    """Maintain a relation of tracks or instances from now on. It begins with the present relations.

    semap query add near_room --map office --concept Room --predicate within_distance --distance 1

    semap query add close --map office --object track --predicate within_distance --distance 2
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.relation.queries import add_query, declaration_from_sql, lacks_instances  # noqa: PLC0415

    edges = options.edges(
        debounce, margin, confirm, probability, (longest_gap, fastest) if between_samples else None
    )
    asked = Declaration(
        name=name,
        predicate=predicate,
        subject=options.side(subject_kind, subject_concept, subject_where, "--subject-where"),
        object=options.side(object_kind, concept, where, "--where"),
        distance_m=distance,
        count=count,
        angle_rad=None if angle is None else math.radians(angle),
        speed_mps=speed,
        direction=direction,  # type: ignore[arg-type]
        abstraction=abstraction,
        dimensions=2 if flat else 3,
    )
    with database(dsn, map_name) as opened, one_transaction(opened, "semap_api") as connection:
        if sql is not None:
            options.require_plain(asked)
            asked = declaration_from_sql(connection, name, sql)
        asked = replace(asked, **edges, follows_amendments=follows_amendments)
        made = add_query(connection, map_name, asked, sql=sql)
        is_empty = lacks_instances(connection, made)
    if is_empty:
        say(
            f"note: no instance of map {map_name} that it is about has the abstraction"
            f" {made.declaration.abstraction}: nothing can hold until one has",
            err=True,
        )
    say(f"Query {made.query_id} made: {name}. Let a rule listen to it: semap rule add")


def enable(query_id: QueryId, dsn: Dsn = None) -> None:
    """Maintain its relations again, from the present state on."""
    _enable(query_id, True, dsn)


def disable(query_id: QueryId, dsn: Dsn = None) -> None:
    """End its relations, and stop evaluating it."""
    _enable(query_id, False, dsn)


def _enable(query_id: int, enabled: bool, dsn: str | None) -> None:
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.relation.queries import enable_query  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        done = enable_query(connection, query_id, enabled)
    say(f"Query {done.name} is {'enabled' if done.enabled else 'disabled'}.")


def delete(query_id: QueryId, dsn: Dsn = None) -> None:
    """Delete a query that no rule reads; its relations end."""
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.relation.queries import delete_query  # noqa: PLC0415

    with database(dsn) as opened, one_transaction(opened, "semap_api") as connection:
        delete_query(connection, query_id)
    say(f"Query {query_id} deleted.")


def now(
    name: Annotated[str | None, typer.Argument(help="Only by the query of this name.")] = None,
    map_name: MapOption = None,
    track: Annotated[str | None, typer.Option(help="Only this track.")] = None,
    room: Annotated[str | None, typer.Option(help="Only this instance.")] = None,
    as_of: AsOf = None,
    as_json: AsJson = False,
    dsn: Dsn = None,
) -> None:
    """Show the current relations with their beginning; or those as of a time, with end and duration."""
    from semap.store.relation.relation_spans import Chosen  # noqa: PLC0415

    relations.show(Chosen(map_name, name, track, room, as_of=as_of), as_json, dsn)


def watch(
    name: Annotated[str, typer.Argument(help="Name of the query.")],
    map_name: Annotated[str, typer.Option("--map", help="Its map.")],
    limit: Annotated[
        int | None, typer.Option(help="Stop after so many changes. [default: go on until Ctrl-C]", min=0)
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, an object a line.")] = False,
    dsn: Dsn = None,
) -> None:
    """Show the current relations, and then each change once, as it is committed.

    `=` holds, `+` began, `-` ended, `x` crossed a line; with the transition time and, if it is later, the
    stamp of confirmation. Late states correct the past: changes are `added`, and former ones `retracted`.
    """
    from semap.store.database.connection import one_transaction  # noqa: PLC0415
    from semap.store.relation.queries import find_query  # noqa: PLC0415
    from semap.worker.query_watch import watch_query  # noqa: PLC0415

    with database(dsn, map_name) as opened:
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
                print_json_line(asdict(delta)) if as_json else say(_line(delta))
        except KeyboardInterrupt:
            return


def _line(delta: Delta) -> str:
    sign = {None: "=", "began": "+", "ended": "-", "crossed": "x"}[delta.kind]
    at, known = clock(delta.at), ""
    if delta.known is not None and delta.known != delta.at:
        known = f"  (known {clock(delta.known)})"
    direction = "" if delta.direction is None else f"  {delta.direction.replace('_', ' ')}"
    cause = "" if delta.cause in (None, "moved") else f"  {delta.cause}"
    amendment = "" if delta.amendment is None else f"  ({delta.amendment})"
    return f"{sign} {at}  {delta.subject}  {delta.object}{direction}{cause}{known}{amendment}"
