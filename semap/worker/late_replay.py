"""Rows that came too late are given to the rules after all: events that lack for want of them are added.

Each rule runs again over the span that late rows affect, and over what it looks back on before. What it finds
there and the log lacks is added. Events of which the evidence was taken back, after late states, are
retracted. The states of live rules stay as they are, and so do events that a late row would have prevented;
those are for a recomputation to retract. The same again adds nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from math import isinf

import psycopg
from psycopg.types.json import Jsonb

from semap.intake.backfill import enriched_for, looks_back
from semap.intake.history_rows import SINCE_EVER, Span, history_rows
from semap.intake.inputs import read_rule
from semap.intake.map_facts import MapFacts
from semap.intake.stored_facts import load_map_facts
from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.engine.event_document import event_json
from semap.rules.engine.rule import Rule
from semap.rules.engine.rule_order import order_of_rules
from semap.rules.engine.run_over import run_over
from semap.rules.lookback import lookback_us
from semap.store.database.connection import connect, translated
from semap.timeline.stamp import parse_stamp, to_datetime, to_us
from semap.worker.progress import ROLE, WORKER

LATE = """
    select l.map_id, min(l.stamp), array_agg(l.late_row_id),
           p.watermarks -> 'maps' -> l.map_id::text -> 'released_us'
    from semap.late_row l join semap.map m using (map_id) join semap.progress p on p.worker = %s
    where l.replayed_at is null and (m.name = %s or %s::text is null)
    group by l.map_id, p.watermarks order by l.map_id
"""
RULES = """
    select r.rule_id, semap.rule_json(r), v.declared_at
    from semap.rule r join semap.rule_version v using (rule_id, version)
    where r.map_id = %s and r.enabled
"""
WINDOWS_BEFORE = 10
"""So many of its windows before the first late row a rule begins: no match reaches over its beginning."""


@dataclass(frozen=True)
class Replay:
    """What was done: late rows given to the rules, events added; what rules gave up in it, by name."""

    rows: int
    events: int
    given_up: Mapping[str, GivenUp] = field(default_factory=dict)


@dataclass(frozen=True)
class InForce:
    """A rule, and from which stamp or else from which moment of our clock on rows are its own."""

    rule: Rule
    backfill_from_us: int | None
    declared_at: datetime


def replay_late(dsn: str, map_name: str | None = None) -> Replay:
    """Give late rows to the rules, those of one map or of all."""
    rows = events = 0
    given_up: dict[str, GivenUp] = {}
    with connect(dsn, ROLE, application="semap rule replay-late") as connection, translated():
        late = connection.execute(LATE, [WORKER, map_name, map_name]).fetchall()
        for map_id, first, ids, released_us in late:
            events += _replay(connection, map_id, to_us(first), released_us, given_up)
            connection.execute("select semap.retract_events(%s, %s)", [map_id, ids])
            connection.execute(
                "update semap.late_row set replayed_at = clock_timestamp() where late_row_id = any (%s)",
                [ids],
            )
            rows += len(ids)
    return Replay(rows, events, given_up)


def _replay(
    connection: psycopg.Connection,
    map_id: int,
    first_us: int,
    released_us: int,
    given_up: dict[str, GivenUp],
) -> int:
    """Run the rules of a map from the first late row to where they had come; those that are read first."""
    in_force = _rules(connection, map_id)
    names = frozenset(in_force)
    facts = load_map_facts(connection)
    order = order_of_rules({name: _rules_read(each.rule, names) for name, each in in_force.items()})
    added = 0
    for name in order:
        found = _found(connection, in_force[name], names, facts, first_us, released_us, given_up)
        added += _add(connection, found)
    return added


def _found(
    connection: psycopg.Connection,
    in_force: InForce,
    names: frozenset[str],
    facts: MapFacts,
    first_us: int,
    released_us: int,
    given_up: dict[str, GivenUp],
) -> Sequence[Event]:
    """What a rule finds from the first late row on."""
    rule = in_force.rule.among(names)
    span = Span(
        _begin_us(in_force, first_us),
        released_us,
        received_from=in_force.declared_at if in_force.backfill_from_us is None else SINCE_EVER,
        with_held=looks_back(rule.declaration),
    )
    rows = history_rows(connection, rule, names, span, facts)
    events = run_over(
        [rule],
        enriched_for(connection, rule, rows),
        released_us,
        tell=lambda told, what: given_up.update({told.name: what}),
    )
    return [event for event in events if event.stamp >= to_datetime(first_us)]


def _begin_us(in_force: InForce, first_us: int) -> int | None:
    back_us = WINDOWS_BEFORE * lookback_us([in_force.rule.declaration])
    begin_us = None if isinf(back_us) else first_us - int(back_us)
    if in_force.backfill_from_us is None:
        return begin_us
    return max(begin_us or in_force.backfill_from_us, in_force.backfill_from_us)


def _rules(connection: psycopg.Connection, map_id: int) -> dict[str, InForce]:
    found: dict[str, InForce] = {}
    for rule_id, document, declared_at in connection.execute(RULES, [map_id]).fetchall():
        rule = read_rule(rule_id, document)
        if rule is not None:
            backfill_from = document["backfill_from"]
            from_us = None if backfill_from is None else parse_stamp(backfill_from)
            found[rule.name] = InForce(rule, from_us, declared_at)
    return found


def _rules_read(rule: Rule, names: frozenset[str]) -> list[str]:
    inputs = rule.declaration.inputs
    return [item.name for item in inputs if rule.source_of(item, names) == "event"]


def _add(connection: psycopg.Connection, events: Sequence[Event]) -> int:
    if not events:
        return 0
    row = connection.execute(
        "select semap.add_events(%s, %s)", [WORKER, Jsonb([event_json(event) for event in events])]
    ).fetchone()
    return 0 if row is None else int(row[0])
