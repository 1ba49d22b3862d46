"""Continuous queries: which relations are kept for a map."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from sqlalchemy import Connection, delete, insert, select, text, update

from semap.cql2 import parse
from semap.cql2.text import read_text
from semap.errors import Conflict, InvalidInput, NotFound
from semap.model.continuous_query import (
    BetweenSamples,
    Certainty,
    Debounce,
    Declaration,
    Side,
)
from semap.store.database.connection import translated
from semap.store.database.tables import concept, continuous_query, map_, rule, rule_query
from semap.store.map.concept import concept_id
from semap.store.map.maps import map_id_of
from semap.store.relation.conditions import keep_condition
from semap.store.relation.query_check import PARAMETERS, require_meaning

_RESULT = text("""
    select place, result from semap.result_page(:query_id, cast(:after as bigint[]), :limit)
""")

_LACKING = text("""
    select case
      when in_pairs then exists (
        select from (values (false, subject_kind), (true, object_kind)) s (is_object, kind)
        where kind = 'instance' and not exists (
          select from semap.pair_instance m
          where m.query_id = q.query_id and m.is_object = s.is_object))
      else not exists (select from semap.region r where r.query_id = q.query_id) end
    from semap.continuous_query q where q.query_id = :query_id and q.enabled
""")


@dataclass(frozen=True)
class Query:
    """While enabled, the relation that is declared is kept true on its map.

    sql  the text that it was declared by, if it was
    """

    query_id: int
    map: str
    declaration: Declaration
    enabled: bool
    sql: str | None = None

    @property
    def name(self) -> str:
        return self.declaration.name


def list_queries(
    connection: Connection, *, map_name: str | None = None, after: int = 0, limit: int = 100
) -> tuple[Query, ...]:
    """At most `limit` queries in the order of their ids, from the first after `after`."""
    found = _QUERIES.where(continuous_query.c.query_id > after).order_by(continuous_query.c.query_id)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    with translated():
        return tuple(_query(dict(row._mapping)) for row in connection.execute(found.limit(limit)))


def get_query(connection: Connection, query_id: int) -> Query:
    """raises NotFound"""
    with translated():
        row = connection.execute(_QUERIES.where(continuous_query.c.query_id == query_id)).one_or_none()
    if row is None:
        raise NotFound("query", query_id, "List the queries to see their ids.")
    return _query(dict(row._mapping))


def find_query(connection: Connection, map_name: str, name: str) -> Query:
    """The query of a name on a map; raises NotFound"""
    map_id = map_id_of(connection, map_name)
    with translated():
        row = connection.execute(
            _QUERIES.where(continuous_query.c.map_id == map_id, continuous_query.c.name == name)
        ).one_or_none()
    if row is None:
        raise NotFound("query", name, f"List the queries of the map: semap query list --map {map_name}")
    return _query(dict(row._mapping))


def add_query(
    connection: Connection, map_name: str, declaration: Declaration, *, sql: str | None = None
) -> Query:
    """A new query; the relations that hold now hold with its transaction, as changes with the cause `map`.

    raises  NotFound if there is no such map, InvalidInput if a concept is unknown or the declaration asks for
            something that cannot be kept, Conflict if the name is taken
    """
    map_id = map_id_of(connection, map_name)
    values = columns_of(connection, map_id, declaration)
    with translated():
        query_id = connection.scalar(
            insert(continuous_query)
            .values(map_id=map_id, sql=sql, **values)
            .returning(continuous_query.c.query_id)
        )
    return get_query(connection, int(query_id or 0))


def declaration_from_sql(connection: Connection, name: str, sql: str) -> Declaration:
    """What a SELECT over the views of `semap_query` asks.

    raises  InvalidInput with line and column of what cannot be kept true, and why, or where the parser is
            not installed
    """
    try:
        from semap.query_text import declaration_of  # noqa: PLC0415
    except ImportError as error:
        raise InvalidInput(
            "queries in SQL need PostgreSQL's parser, which is not installed", "Run: pip install 'semap[sql]'"
        ) from error
    with translated():
        concepts = connection.scalars(select(concept.c.name)).all()
    return declaration_of(name, sql, concepts)


def lacks_instances(connection: Connection, query: Query) -> bool:
    """Whether a side of a query is of instances, and no instance that is meant has what it compares."""
    with translated():
        return bool(connection.scalar(_LACKING, {"query_id": query.query_id}))


def change_query(
    connection: Connection, query_id: int, declaration: Declaration, *, sql: str | None = None
) -> Query:
    """Let a query ask something else from now on; what that changes begins or ends now, with the cause `map`.

    raises  as `add_query` does; Conflict also where rules read it by another name
    """
    map_id = map_id_of(connection, get_query(connection, query_id).map)
    values = columns_of(connection, map_id, declaration)
    with translated():
        connection.execute(
            update(continuous_query).where(continuous_query.c.query_id == query_id).values(sql=sql, **values)
        )
    return get_query(connection, query_id)


@dataclass(frozen=True)
class ResultRow:
    """What holds by a query, as its view has it: JSON by the names of its columns, shapes as GeoJSON [m].

    place  where it stands in the order of ids
    """

    place: tuple[int, int]
    columns: Mapping[str, Any]


def query_result(
    connection: Connection, query_id: int, *, after: tuple[int, int] | None = None, limit: int = 100
) -> tuple[ResultRow, ...]:
    """At most `limit` rows of what holds by a query now.

    after   the place of the last one known; None: from the first one
    raises  NotFound
    """
    get_query(connection, query_id)
    wanted = {"query_id": query_id, "after": after and list(after), "limit": limit}
    with translated():
        rows = connection.execute(_RESULT, wanted).all()
    return tuple(ResultRow((place[0], place[1]), result) for place, result in rows)


def enable_query(connection: Connection, query_id: int, enabled: bool) -> Query:
    """Let a query keep relations, or end all of them.

    raises  NotFound
    """
    with translated():
        connection.execute(
            update(continuous_query).where(continuous_query.c.query_id == query_id).values(enabled=enabled)
        )
    return get_query(connection, query_id)


def delete_query(connection: Connection, query_id: int) -> None:
    """raises NotFound, Conflict while a rule reads it"""
    query = get_query(connection, query_id)
    with translated():
        reading = connection.scalars(
            select(rule.c.name)
            .join(rule_query, rule_query.c.rule_id == rule.c.rule_id)
            .where(rule_query.c.query_id == query_id)
        ).all()
        if reading:
            raise Conflict(
                f"Rules read the query {query.name}: {', '.join(sorted(reading))}.", "Delete them first."
            )
        connection.execute(delete(continuous_query).where(continuous_query.c.query_id == query_id))


def columns_of(connection: Connection, map_id: int, declaration: Declaration) -> Mapping[str, object]:
    """A declaration as columns of `continuous_query`, its conditions compiled; raises as `add_query`."""
    require_meaning(declaration)
    for side in (declaration.subject, declaration.object):
        if side.where is not None:
            keep_condition(connection, map_id, side.kind, side.where)
    sure, between = declaration.certainty, declaration.between_samples
    return {
        "name": declaration.name,
        "predicate": declaration.predicate,
        **_side(connection, "object", declaration.object),
        **_side(connection, "subject", declaration.subject),
        **{name: getattr(declaration, name) for name in PARAMETERS},
        "abstraction": declaration.abstraction,
        "dimensions": declaration.dimensions,
        "enter_margin_m": declaration.debounce.enter_margin_m,
        "leave_margin_m": declaration.debounce.leave_margin_m,
        "enter_confirm": timedelta(seconds=declaration.debounce.enter_confirm_s),
        "leave_confirm": timedelta(seconds=declaration.debounce.leave_confirm_s),
        "enter_probability": None if sure is None else sure.enter,
        "leave_probability": None if sure is None else sure.leave,
        "widest_std_m": None if sure is None else sure.widest_std_m,
        "longest_gap": None if between is None else timedelta(seconds=between.longest_gap_s),
        "fastest_mps": None if between is None else between.fastest_mps,
        "follows_amendments": declaration.follows_amendments,
        "payload": dict(declaration.payload),
    }


def read_condition(where: str | Mapping[str, object], place: str = "where") -> Mapping[str, object]:
    """A condition on the tracks or instances of a query, from CQL2 text or JSON, in its JSON form.

    raises  InvalidInput with the place that cannot be read
    """
    document = read_text(where, place) if isinstance(where, str) else where
    if isinstance(document, Mapping):
        parse(document, place)
    else:
        raise InvalidInput("it is no comparison", "Write a condition such as: name = 'Room07'", place)
    return document


def _side(connection: Connection, name: str, side: Side) -> Mapping[str, object]:
    return {
        f"{name}_kind": side.kind,
        f"{name}_concept_id": None if side.concept is None else concept_id(connection, side.concept),
        f"{name}_uids": None if side.uids is None else list(side.uids),
        f"{name}_where": None if side.where is None else dict(side.where),
    }


def _query(row: Mapping[str, Any]) -> Query:
    return Query(row["query_id"], row["map_name"], _declaration(row), row["enabled"], row["sql"])


def _declaration(columns: Mapping[str, Any]) -> Declaration:
    sure = between = None
    if columns["enter_probability"] is not None:
        sure = Certainty(columns["enter_probability"], columns["leave_probability"], columns["widest_std_m"])
    if columns["longest_gap"] is not None:
        between = BetweenSamples(columns["longest_gap"].total_seconds(), columns["fastest_mps"])
    return Declaration(
        name=columns["name"],
        predicate=columns["predicate"],
        subject=_read_side("subject", columns),
        object=_read_side("object", columns),
        **{name: columns[name] for name in PARAMETERS},
        abstraction=columns["abstraction"],
        dimensions=columns["dimensions"],
        debounce=Debounce(
            columns["enter_margin_m"],
            columns["leave_margin_m"],
            columns["enter_confirm"].total_seconds(),
            columns["leave_confirm"].total_seconds(),
        ),
        certainty=sure,
        between_samples=between,
        follows_amendments=columns["follows_amendments"],
        payload=columns["payload"],
    )


def _read_side(name: str, columns: Mapping[str, Any]) -> Side:
    uids = columns[f"{name}_uids"]
    return Side(
        columns[f"{name}_kind"],
        columns[f"{name}_concept"],
        None if uids is None else tuple(uids),
        columns[f"{name}_where"],
    )


_SUBJECT = concept.alias("subject_concept")
_QUERIES = (
    select(
        continuous_query,
        map_.c.name.label("map_name"),
        concept.c.name.label("object_concept"),
        _SUBJECT.c.name.label("subject_concept"),
    )
    .join(map_, map_.c.map_id == continuous_query.c.map_id)
    .outerjoin(concept, concept.c.concept_id == continuous_query.c.object_concept_id)
    .outerjoin(_SUBJECT, _SUBJECT.c.concept_id == continuous_query.c.subject_concept_id)
)
