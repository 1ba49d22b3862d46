"""Rules: which events are made of which relations. The rule worker hears of them through the log."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from sqlalchemy import Connection, case, delete, insert, select, update

from semap.errors import InvalidInput, NotFound
from semap.store.database import translated
from semap.store.maps import map_id_of
from semap.store.tables import continuous_query, map_, rule


class Declared(Protocol):
    """What a declaration, once read and found valid, says to the store."""

    @property
    def name(self) -> str: ...

    @property
    def input(self) -> str: ...

    def as_json(self) -> dict[str, object]: ...


@dataclass(frozen=True)
class Rule:
    """A rule; its version rises with each change of what it declares."""

    rule_id: int
    map: str
    name: str
    version: int
    query: str
    declaration: Mapping[str, object]
    enabled: bool


def list_rules(
    connection: Connection, *, map_name: str | None = None, after: int = 0, limit: int = 100
) -> tuple[Rule, ...]:
    """At most `limit` rules in the order of their ids, from the first after `after`."""
    found = _RULES.where(rule.c.rule_id > after).order_by(rule.c.rule_id).limit(limit)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    with translated():
        return tuple(Rule(*row) for row in connection.execute(found))


def get_rule(connection: Connection, rule_id: int) -> Rule:
    """raises NotFound"""
    with translated():
        row = connection.execute(_RULES.where(rule.c.rule_id == rule_id)).one_or_none()
    if row is None:
        raise NotFound("rule", rule_id, "List the rules to see their ids.")
    return Rule(*row)


def add_rule(connection: Connection, map_name: str, declared: Declared) -> Rule:
    """A new rule on a map.

    raises  NotFound if there is no such map, InvalidInput if the map has no query of the name that the
            rule reads, Conflict if the rule's name is taken
    """
    map_id = map_id_of(connection, map_name)
    query_id = _query_id(connection, map_id, declared.input)
    with translated():
        rule_id = connection.scalar(
            insert(rule)
            .values(map_id=map_id, name=declared.name, query_id=query_id, declaration=declared.as_json())
            .returning(rule.c.rule_id)
        )
    return get_rule(connection, int(rule_id or 0))


def declare_rule(connection: Connection, rule_id: int, declared: Declared) -> Rule:
    """Let a rule declare something else; its version rises if that differs.

    raises  NotFound, InvalidInput if its map has no query of the name that it reads, Conflict if its new
            name is taken
    """
    with translated():
        map_id = connection.scalar(select(rule.c.map_id).where(rule.c.rule_id == rule_id))
    if map_id is None:
        raise NotFound("rule", rule_id, "List the rules to see their ids.")
    values = {
        "name": declared.name,
        "query_id": _query_id(connection, map_id, declared.input),
        "declaration": declared.as_json(),
    }
    is_same = (
        (rule.c.name == values["name"])
        & (rule.c.query_id == values["query_id"])
        & (rule.c.declaration == values["declaration"])
    )
    version = case((is_same, rule.c.version), else_=rule.c.version + 1)
    with translated():
        connection.execute(update(rule).where(rule.c.rule_id == rule_id).values(version=version, **values))
    return get_rule(connection, rule_id)


def enable_rule(connection: Connection, rule_id: int, enabled: bool) -> Rule:
    """Let a rule make events, or rest.

    raises  NotFound
    """
    with translated():
        connection.execute(update(rule).where(rule.c.rule_id == rule_id).values(enabled=enabled))
    return get_rule(connection, rule_id)


def delete_rule(connection: Connection, rule_id: int) -> None:
    """The events that it made stay.

    raises  NotFound
    """
    with translated():
        gone = connection.scalar(delete(rule).where(rule.c.rule_id == rule_id).returning(rule.c.rule_id))
    if gone is None:
        raise NotFound("rule", rule_id, "List the rules to see their ids.")


def _query_id(connection: Connection, map_id: int, name: str) -> int:
    with translated():
        found = connection.scalar(
            select(continuous_query.c.query_id).where(
                continuous_query.c.map_id == map_id, continuous_query.c.name == name
            )
        )
    if found is None:
        raise InvalidInput(f"there is no query {name} on this map", "Add it first, or name another.", "input")
    return int(found)


_RULES = (
    select(
        rule.c.rule_id,
        map_.c.name,
        rule.c.name,
        rule.c.version,
        continuous_query.c.name,
        rule.c.declaration,
        rule.c.enabled,
    )
    .join(map_, map_.c.map_id == rule.c.map_id)
    .join(continuous_query, continuous_query.c.query_id == rule.c.query_id)
)
