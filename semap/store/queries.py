"""Continuous queries: which relations are kept for a map."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import Connection, delete, insert, select, update

from semap.errors import Conflict, NotFound
from semap.store.concept import concept_id
from semap.store.database import translated
from semap.store.maps import map_id_of
from semap.store.tables import concept, continuous_query, map_, rule, rule_query


@dataclass(frozen=True)
class Query:
    """While enabled, each track is related to every instance of the concept that contains it."""

    query_id: int
    map: str
    name: str
    predicate: str
    concept: str
    enabled: bool


def list_queries(
    connection: Connection, *, map_name: str | None = None, after: int = 0, limit: int = 100
) -> tuple[Query, ...]:
    """At most `limit` queries in the order of their ids, from the first after `after`."""
    found = _QUERIES.where(continuous_query.c.query_id > after).order_by(continuous_query.c.query_id)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    with translated():
        return tuple(Query(*row) for row in connection.execute(found.limit(limit)))


def get_query(connection: Connection, query_id: int) -> Query:
    """raises NotFound"""
    with translated():
        row = connection.execute(_QUERIES.where(continuous_query.c.query_id == query_id)).one_or_none()
    if row is None:
        raise NotFound("query", query_id, "List the queries to see their ids.")
    return Query(*row)


def add_query(connection: Connection, map_name: str, name: str, concept_name: str) -> Query:
    """A new query for which tracks each instance of a concept, or of one below it, contains.

    raises  NotFound if there is no such map, InvalidInput if there is no such concept, Conflict if the
            name is taken
    """
    map_id = map_id_of(connection, map_name)
    object_concept_id = concept_id(connection, concept_name)
    with translated():
        query_id = connection.scalar(
            insert(continuous_query)
            .values(map_id=map_id, name=name, predicate="contains", object_concept_id=object_concept_id)
            .returning(continuous_query.c.query_id)
        )
    return get_query(connection, int(query_id or 0))


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


_QUERIES = (
    select(
        continuous_query.c.query_id,
        map_.c.name,
        continuous_query.c.name,
        continuous_query.c.predicate,
        concept.c.name,
        continuous_query.c.enabled,
    )
    .join(map_, map_.c.map_id == continuous_query.c.map_id)
    .join(concept, concept.c.concept_id == continuous_query.c.object_concept_id)
)
