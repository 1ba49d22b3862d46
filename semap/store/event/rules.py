"""Rules: which events are made of what. The rule worker hears of them through the log.

What a rule declares is read elsewhere. Its version, and the queries that it keeps from being deleted, follow
in the database (sql/220_rule.sql).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from difflib import get_close_matches
from typing import Any, Protocol

from sqlalchemy import Connection, delete, insert, select, update

from semap.errors import Conflict, InvalidInput, NotFound
from semap.model.given_up import GivenUp
from semap.store.database.connection import translated
from semap.store.database.tables import (
    continuous_query,
    map_,
    object_state,
    rule,
    rule_given_up,
    rule_version,
)
from semap.store.map.history import lock_edits
from semap.store.map.maps import map_id_of
from semap.timeline.stamp import EARLIEST, require_usual

SINCE_EVER = EARLIEST
"""A rule that is to run over all that is stored begins here: nothing that is stored is older."""

SLIP = 0.85
"""From this likeness on (`difflib`) a name that is not known is taken for another one misspelt."""

REMEDY = "List the rules to see their ids."


class DeclaredInput(Protocol):
    """Something that a declaration reads."""

    @property
    def name(self) -> str: ...

    @property
    def kind(self) -> str | None: ...


class Declared(Protocol):
    """What a declaration, once read and found valid, says to the store."""

    @property
    def name(self) -> str: ...

    @property
    def inputs(self) -> Sequence[DeclaredInput]: ...

    def as_json(self) -> Mapping[str, object]: ...


@dataclass(frozen=True)
class Rule:
    """A rule; its version rises with each change of what it declares.

    queries        names of the continuous queries that it reads
    backfill_from  the stamp from which on this version was to run over what was stored before it
    given_up       by this version, since too much was under way in a key
    """

    rule_id: int
    map: str
    name: str
    version: int
    queries: tuple[str, ...]
    declaration: Mapping[str, object]
    enabled: bool
    backfill_from: datetime | None = None
    given_up: GivenUp | None = None


@dataclass(frozen=True)
class RuleVersion:
    """What a rule declared, and since when."""

    version: int
    name: str
    declaration: Mapping[str, object]
    declared_at: datetime


def list_rules(
    connection: Connection, *, map_name: str | None = None, after: int = 0, limit: int | None = 100
) -> tuple[Rule, ...]:
    """At most `limit` rules (None: all) in the order of their ids, from the first after `after`."""
    found = _RULES.where(rule.c.rule_id > after).order_by(rule.c.rule_id).limit(limit)
    if map_name is not None:
        found = found.where(map_.c.name == map_name)
    with translated():
        return tuple(_rule(row) for row in connection.execute(found))


def get_rule(connection: Connection, rule_id: int) -> Rule:
    """raises NotFound"""
    with translated():
        row = connection.execute(_RULES.where(rule.c.rule_id == rule_id)).one_or_none()
    if row is None:
        raise NotFound("rule", rule_id, REMEDY)
    return _rule(row)


def find_rule(connection: Connection, known_as: str, map_name: str | None = None) -> Rule:
    """The rule of this number or name.

    raises  NotFound, InvalidInput if rules of several maps have that name
    """
    if known_as.isascii() and known_as.isdigit() and len(known_as) < 10:
        return get_rule(connection, int(known_as))
    found = _RULES.where(rule.c.name == known_as)
    if map_name is not None:
        found = found.where(rule.c.map_id == map_id_of(connection, map_name))
    with translated():
        rows = connection.execute(found).all()
    if not rows:
        raise NotFound("rule", known_as, "List the rules to see their names.")
    if len(rows) > 1:
        raise InvalidInput(f"there is a rule {known_as} on {len(rows)} maps", "Name the map, too.", "rule")
    return _rule(rows[0])


def list_versions(
    connection: Connection, rule_id: int, *, after: int = 0, limit: int | None = None
) -> tuple[RuleVersion, ...]:
    """What a rule declared in its versions after `after`, in their order; all, or at most `limit`.

    raises  NotFound
    """
    get_rule(connection, rule_id)
    with translated():
        rows = connection.execute(
            select(
                rule_version.c.version,
                rule_version.c.name,
                rule_version.c.declaration,
                rule_version.c.declared_at,
            )
            .where(rule_version.c.rule_id == rule_id, rule_version.c.version > after)
            .order_by(rule_version.c.version)
            .limit(limit)
        )
        return tuple(RuleVersion(*row) for row in rows)


def add_rule(
    connection: Connection, map_name: str, declared: Declared, *, backfill_from: datetime | None = None
) -> Rule:
    """A new rule on a map, for what comes from now on and, with `backfill_from`, for what came since then.

    raises  NotFound if there is no such map, InvalidInput if the map has not what the rule reads, Conflict
            if the rule's name is taken
    """
    map_id = map_id_of(connection, map_name)
    values = _values(connection, map_id, declared, backfill_from)
    _require_free(connection, map_id, declared.name)
    with translated():
        rule_id = connection.scalar(insert(rule).values(map_id=map_id, **values).returning(rule.c.rule_id))
    return get_rule(connection, int(rule_id or 0))


def queries_read(
    connection: Connection, map_name: str, declared: Declared, replaces: int | None = None
) -> frozenset[str]:
    """The names of the queries that a rule would read, added to a map or in place of another.

    raises  as `add_rule`; nothing is written
    """
    map_id = map_id_of(connection, map_name)
    found = _queries_read(connection, map_id, declared)
    _require_free(connection, map_id, declared.name, replaces)
    return frozenset(found)


def declare_rule(
    connection: Connection, rule_id: int, declared: Declared, *, backfill_from: datetime | None = None
) -> Rule:
    """Let a rule declare something else; its version rises if that differs.

    raises  NotFound, InvalidInput if its map has not what it reads, Conflict if its new name is taken
    """
    with translated():
        map_id = connection.scalar(select(rule.c.map_id).where(rule.c.rule_id == rule_id))
    if map_id is None:
        raise NotFound("rule", rule_id, REMEDY)
    values = _values(connection, map_id, declared, backfill_from)
    with translated():
        connection.execute(update(rule).where(rule.c.rule_id == rule_id).values(**values))
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
        raise NotFound("rule", rule_id, REMEDY)


def edit_alone(connection: Connection) -> None:
    """Keep everybody else from editing maps and rules until the transaction ends."""
    with translated():
        lock_edits(connection)


def _require_free(connection: Connection, map_id: int, name: str, replaces: int | None = None) -> None:
    """raises Conflict if a rule, other than the one that is replaced, has this name on the map"""
    with translated():
        taken = connection.scalar(select(rule.c.rule_id).where(rule.c.map_id == map_id, rule.c.name == name))
    if taken not in (None, replaces):
        raise Conflict(f"There is a rule {name} on this map already.", "Replace it, or choose another name.")


def _values(
    connection: Connection, map_id: int, declared: Declared, backfill_from: datetime | None
) -> dict[str, object]:
    if backfill_from is not None:
        require_usual(backfill_from, "backfill_from")
    return {
        "name": declared.name,
        "queries": _queries_read(connection, map_id, declared),
        "declaration": dict(declared.as_json()),
        "backfill_from": backfill_from,
    }


def _queries_read(connection: Connection, map_id: int, declared: Declared) -> dict[str, int]:
    """Of what is read, the queries with their ids.

    A name alone is a query's if there is one, else a rule's, else an object's property.
    """
    with translated():
        found = connection.execute(
            select(continuous_query.c.name, continuous_query.c.query_id).where(
                continuous_query.c.map_id == map_id
            )
        )
        queries: dict[str, int] = dict(found.all())
        rules = set(connection.scalars(select(rule.c.name).where(rule.c.map_id == map_id)))
    for each in declared.inputs:
        known: Mapping[str | None, set[str]] = {"query": set(queries), "rule": rules}
        if each.kind in known and each.name not in known[each.kind]:
            raise InvalidInput(
                f"there is no {each.kind} {each.name} on this map",
                f"Add it first, or name another{_suggestion(each.name, known[each.kind])}.",
                "input",
            )
        if each.kind is None and each.name not in queries.keys() | rules:
            _require_no_slip(connection, map_id, each.name, queries.keys() | rules)
    wanted = {each.name for each in declared.inputs if each.kind in (None, "query")}
    return {name: query_id for name, query_id in queries.items() if name in wanted}


def _require_no_slip(connection: Connection, map_id: int, name: str, known: set[str]) -> None:
    """raises InvalidInput for a name that is nearly a query's or a rule's, and no property of an object"""
    near = _suggestion(name, known, SLIP)
    seen = select(object_state.c.object_state_id).where(
        object_state.c.map_id == map_id, object_state.c.property == name
    )
    with translated():
        if near and connection.scalar(seen.limit(1)) is None:
            raise InvalidInput(
                f"there is no query or rule {name} on this map, and no object has a state of that name",
                f"Mend the name{near}. For a property of objects, write {{object_state: {name}}}.",
                "input",
            )


def _suggestion(name: str, known: set[str], likeness: float = 0.6) -> str:
    near = get_close_matches(name, sorted(known), n=1, cutoff=likeness)
    return f" (did you mean {near[0]}?)" if near else ""


def _rule(row: Sequence[Any]) -> Rule:
    rule_id, map_name, name, version, queries, declaration, enabled, backfill_from, *given_up = row
    return Rule(
        rule_id,
        map_name,
        name,
        version,
        tuple(sorted(queries)),
        declaration,
        enabled,
        backfill_from,
        None if given_up[0] is None else GivenUp(*given_up),
    )


_RULES = (
    select(
        rule.c.rule_id,
        map_.c.name,
        rule.c.name,
        rule.c.version,
        rule.c.queries,
        rule.c.declaration,
        rule.c.enabled,
        rule.c.backfill_from,
        rule_given_up.c.attempts,
        rule_given_up.c.first,
        rule_given_up.c.key,
        rule_given_up.c.matches,
    )
    .join(map_, map_.c.map_id == rule.c.map_id)
    .outerjoin(rule_given_up, rule_given_up.c.rule_id == rule.c.rule_id)
)
