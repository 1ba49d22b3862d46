"""Edits of rules that look at more than the rule itself: what reads what, and in which order.

Each is alone with the map until its transaction ends, so that no two edits make a circle between them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from datetime import datetime
from typing import Literal

from sqlalchemy import Connection

from semap.errors import Conflict
from semap.rules.declaration import Declaration
from semap.rules.engine.rule_order import order_of_rules
from semap.rules.language.reading import parse_declaration
from semap.store import rules
from semap.store.rules import SINCE_EVER, Rule
from semap.timeline.stamp import parse_stamp, to_datetime

ALL: Literal["all"] = "all"


def backfill_stamp(text: str) -> datetime:
    """The stamp from which on a rule is to run over the past: a stamp, or `all`.

    raises  InvalidInput
    """
    return SINCE_EVER if text == ALL else to_datetime(parse_stamp(text))


def add_rule(
    connection: Connection, map_name: str, declaration: Declaration, backfill_from: datetime | None = None
) -> Rule:
    """A new rule.

    raises  NotFound, Conflict, InvalidInput; the last also if rules would read one another in a circle
    """
    rules.edit_alone(connection)
    made = rules.add_rule(connection, map_name, declaration, backfill_from=backfill_from)
    _require_no_circle(connection, map_name)
    return made


def replace_rule(
    connection: Connection, rule_id: int, declaration: Declaration, backfill_from: datetime | None = None
) -> Rule:
    """Let a rule declare something else.

    raises  as `add_rule`; Conflict also where it would lose the name by which others read it
    """
    rules.edit_alone(connection)
    before = rules.get_rule(connection, rule_id)
    if declaration.name != before.name:
        _require_unread(connection, before)
    after = rules.declare_rule(connection, rule_id, declaration, backfill_from=backfill_from)
    _require_no_circle(connection, after.map)
    return after


def require_fits(
    connection: Connection, map_name: str, declaration: Declaration, replaced: Rule | None = None
) -> None:
    """See that a rule could be added, or replace another of the map; nothing is written, nobody waits.

    raises  as `add_rule` and `replace_rule`
    """
    queries = rules.queries_read(
        connection, map_name, declaration, None if replaced is None else replaced.rule_id
    )
    reading = dict(_reading(connection, map_name))
    if replaced is not None:
        if declaration.name != replaced.name:
            _require_unread(connection, replaced)
        del reading[replaced.name]
    names = frozenset((*reading, declaration.name))
    order_of_rules({**reading, declaration.name: _rules_among(declaration, queries, names)})


def delete_rule(connection: Connection, rule_id: int) -> None:
    """Delete a rule that no other reads; the events that it made stay.

    raises  NotFound, Conflict
    """
    rules.edit_alone(connection)
    _require_unread(connection, rules.get_rule(connection, rule_id))
    rules.delete_rule(connection, rule_id)


def _require_unread(connection: Connection, rule: Rule) -> None:
    """raises Conflict with the names of the rules that read this one's events"""
    reading = [name for name, read in _reading(connection, rule.map).items() if rule.name in read]
    if reading:
        raise Conflict(
            f"Rules read the events of {rule.name}: {', '.join(sorted(reading))}.",
            "Delete them first, or let them read something else.",
        )


def _require_no_circle(connection: Connection, map_name: str) -> None:
    order_of_rules(_reading(connection, map_name))


def _reading(connection: Connection, map_name: str) -> Mapping[str, frozenset[str]]:
    """Of each rule of a map, the rules whose events it reads."""
    known = rules.list_rules(connection, map_name=map_name, limit=None)
    names = frozenset(rule.name for rule in known)
    return {rule.name: _rules_read(rule, names) for rule in known}


def _rules_read(rule: Rule, names: frozenset[str]) -> frozenset[str]:
    return _rules_among(parse_declaration(rule.declaration, rule.name), rule.queries, names)


def _rules_among(declaration: Declaration, queries: Collection[str], names: frozenset[str]) -> frozenset[str]:
    """Of the names of rules, those that a declaration reads; a query of the same name comes first."""
    return names & {
        each.name
        for each in declaration.inputs
        if each.kind == "rule" or (each.kind is None and each.name not in queries)
    }
