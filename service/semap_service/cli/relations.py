"""semap relations"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Annotated

import typer

from semap.errors import InvalidInput, NotFound
from semap_service.cli.output import print_rows
from semap_service.cli.session import AsJson, Dsn, database
from semap_service.cli.stamp import AsOf, From, To, require_order

if TYPE_CHECKING:
    import psycopg

CHOSEN = """
    (%(map)s::text is null or map = %(map)s) and (%(query)s::text is null or query = %(query)s)
    and (%(track)s::text is null or track = %(track)s or object_track = %(track)s)
    and (%(room)s::text is null or instance = %(room)s or subject_instance = %(room)s)
"""
KNOWN = """
    select %(map)s::text is null or exists (select from semap.map where name = %(map)s),
           %(query)s::text is null or exists (
             select from semap.continuous_query q join semap.map m using (map_id)
             where q.name = %(query)s and (%(map)s::text is null or m.name = %(map)s))
"""
NOW = f"""
    select map, query, subject, object, since from semap.relation_now where {CHOSEN}
    order by map, object, subject, query
"""  # noqa: S608  (constants)
SPAN = "map, query, subject, object, since, until, extract(epoch from duration)::float8 as duration_s"
AS_OF = f"""
    select {SPAN} from semap.relations_as_of(%(as_of)s) where {CHOSEN}
    order by map, object, subject, query
"""  # noqa: S608  (constants)
BETWEEN = f"""
    select {SPAN} from semap.relation_span
    where {CHOSEN}
      and tstzrange(since, until, '[]') && tstzrange(%(start)s::timestamptz, %(end)s::timestamptz)
      and (%(start)s::timestamptz is null or until is null or until > %(start)s)
    order by since, map, object, subject, query
"""  # noqa: S608  (constants)


@dataclass(frozen=True)
class Chosen:
    """Which relations: those of which all of this is true.

    as_of       those that held then; None: not asked
    start, end  those that held at some time in between; None: without bound
    """

    map: str | None = None
    query: str | None = None
    track: str | None = None
    room: str | None = None
    as_of: datetime | None = None
    start: datetime | None = None
    end: datetime | None = None


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
    require_order(start, end)
    if as_of is not None and (start is not None or end is not None):
        raise InvalidInput("one moment, or the time between two", "Leave one out.", "--as-of, --from, --to")
    show(Chosen(map_name, query, track, room, as_of, start, end), as_json, dsn)


def show(chosen: Chosen, as_json: bool, dsn: str | None) -> None:
    """Print what holds or held, with how long it did."""
    from semap.store.database import connect, translated  # noqa: PLC0415

    is_past = chosen.start is not None or chosen.end is not None
    statement = AS_OF if chosen.as_of is not None else BETWEEN if is_past else NOW
    with database(dsn) as opened, connect(opened, "semap_read") as connection, translated():
        cursor = connection.execute(statement, vars(chosen))
        columns = [column.name for column in cursor.description or ()]
        rows = [dict(zip(columns, row, strict=True)) for row in cursor]
        if not rows:
            _require_known(connection, chosen)
    print_rows(rows, as_json, "No relation holds now." if statement == NOW else "No relation held then.")


def _require_known(connection: psycopg.Connection, chosen: Chosen) -> None:
    """raises NotFound where nothing can hold, since there is no such map or query"""
    is_map, is_query = connection.execute(KNOWN, vars(chosen)).fetchone() or (True, True)
    if not is_map:
        raise NotFound("map", chosen.map, "List the maps: semap map list")
    if not is_query:
        raise NotFound("query", chosen.query, "List the queries: semap query list")
