"""Rules over stored history, beside the worker and without writing: dry runs, gaps in what they find, and
rules that it suggests."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import psycopg

from semap.errors import InvalidInput, NotFound
from semap.intake.backfill import enriched_for, looks_back
from semap.intake.history_rows import Span, history_rows
from semap.intake.kept import require_kept, require_states
from semap.intake.stored_facts import load_map_facts
from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.confidence import learn
from semap.rules.declaration import Declaration
from semap.rules.engine.rule import Rule
from semap.rules.engine.run_over import run_over
from semap.rules.language.reading import parse_declaration
from semap.rules.mining import Proposal, Wanted, mine
from semap.rules.needs import needs_of
from semap.rules.row import Row
from semap.store.database.connection import translated
from semap.timeline.stamp import to_us

MAP = """
    select m.map_id,
           coalesce((select jsonb_object_agg(name, query_id)
                     from semap.continuous_query q where q.map_id = m.map_id), '{}'),
           array(select name from semap.rule r where r.map_id = m.map_id)
    from semap.map m where m.name = %s
"""
HEARD = """
    select nullif(max(coalesce(watermark, newest_stamp)), '-infinity') from semap.source where map_id = %s
"""


@dataclass(frozen=True)
class PastOfMap:
    """What a rule may read on a map, and its history; `heard_us` is how far the newest source has come."""

    connection: psycopg.Connection
    map_id: int
    queries: dict[str, int]
    rule_names: frozenset[str]
    heard_us: int | None

    def rule(self, declaration: Declaration) -> Rule:
        """A rule as it would be in force on this map."""
        read = {item.name for item in declaration.inputs if item.kind in (None, "query")}
        queries = {name: query_id for name, query_id in self.queries.items() if name in read}
        others = self.rule_names - {declaration.name}
        return Rule(0, self.map_id, 1, True, declaration, queries).among(others)

    def require_kept(self, rule: Rule, since: datetime) -> None:
        """raises InvalidInput where some of what a rule reads from then on was dropped"""
        require_kept(self.connection, "changes", since)
        needs = needs_of(rule.declaration)
        if needs.actor_within_m or needs.position:
            require_states(self.connection, self.map_id, since)

    def rows(self, rule: Rule, span: Span) -> list[Row]:
        """The rows that a rule reads, with what it needs of them."""
        facts = load_map_facts(self.connection)
        rows = history_rows(self.connection, rule, self.rule_names, span, facts)
        return list(enriched_for(self.connection, rule, rows))


def past_of_map(connection: psycopg.Connection, map_name: str) -> PastOfMap:
    """raises NotFound"""
    with translated():
        row = connection.execute(MAP, [map_name]).fetchone()
        if row is None:
            raise NotFound("map", map_name, "List them: semap map list")
        heard = connection.execute(HEARD, [row[0]]).fetchone()
    map_id, queries, rule_names = row
    heard_us = None if heard is None or heard[0] is None else to_us(heard[0])
    return PastOfMap(connection, map_id, queries, frozenset(rule_names), heard_us)


def dry_run(
    connection: psycopg.Connection,
    map_name: str,
    declaration: Declaration,
    start: datetime | None = None,
    end: datetime | None = None,
    most_rows: int | None = None,
    watch: Callable[[int], None] = lambda count: None,
    tell: Callable[[Rule, GivenUp], None] = lambda rule, given_up: None,
) -> list[Event]:
    """The events that a rule would have made of stored rows with stamps from `start` to before `end`.

    watch   is told again and again how many events there are, and ends the run by raising
    tell    is told at the end of what it gave up, because too much was under way in a key
    raises  NotFound if there is no such map, TooLarge if there are more than `most_rows` in a table,
            InvalidInput if it ends before it begins, or reads what was dropped since `start`
    """
    if start is not None and end is not None and end <= start:
        raise InvalidInput("it ends before it begins", "Give the earlier stamp first.", "to")
    past = past_of_map(connection, map_name)
    from_us = None if start is None else to_us(start)
    end_us = None if end is None else to_us(end) - 1
    rule = past.rule(declaration)
    if start is not None:
        past.require_kept(rule, start)
    rows = past.rows(rule, Span(from_us, end_us, with_held=looks_back(declaration), most_rows=most_rows))
    known_us = [row.stamp_us for row in rows[-1:]] + ([] if past.heard_us is None else [past.heard_us])
    until_us = max(known_us, default=0) if end_us is None else end_us
    events = run_over([rule], rows, until_us, watch, tell)
    return events if start is None else [event for event in events if event.stamp >= start]


@dataclass(frozen=True)
class Mined:
    """A proposal, and the events that it would have made: a dry run of it."""

    proposal: Proposal
    events: list[Event]


def mined(
    connection: psycopg.Connection,
    map_name: str,
    wanted: Wanted,
    inputs: Sequence[str] = (),
    start: datetime | None = None,
    end: datetime | None = None,
    most: int = 10,
) -> list[Mined]:
    """Rules that what is stored suggests, the best first, each with a dry run; nothing is written.

    inputs  names of queries, rules and properties of objects; without any, all rules of the map
    raises  InvalidInput where the map has no rule and no input is named; else as `dry_run`
    """
    past = past_of_map(connection, map_name)
    names = sorted(inputs or past.rule_names)
    if not names:
        raise InvalidInput(
            "the map has no rule whose events could be looked at",
            "Name what to look at: --input track_in_room, --input door.",
            "input",
        )
    document = {"input": names, "emit": {"began": "began"}}
    rule = past.rule(parse_declaration(document, "mine"))
    if start is not None:
        past.require_kept(rule, start)
    from_us = None if start is None else to_us(start)
    rows = past.rows(rule, Span(from_us, None if end is None else to_us(end) - 1))
    return [
        Mined(each, dry_run(connection, map_name, each.declaration, start, end))
        for each in mine(rows, wanted)[:most]
    ]


def learnt(
    connection: psycopg.Connection,
    map_name: str,
    declaration: Declaration,
    start: datetime | None = None,
    end: datetime | None = None,
) -> Declaration:
    """The same rule with those parameters of its confidence under which the gaps in history are likeliest.

    raises  InvalidInput if it declares no confidence, or history has too few gaps; NotFound
    """
    confidence = declaration.confidence
    if confidence is None:
        raise InvalidInput(
            f"the rule {declaration.name} declares no confidence",
            "Add a first guess, such as {gap: [A, B], distribution: lognormal, median_s: 2, sigma: 1}.",
            "confidence",
        )
    # whatever is unlikely by the first guess counts as well
    unsure = replace(declaration, confidence=None)
    events = dry_run(connection, map_name, unsure, start, end)
    gaps_s = [
        gap_s for event in events if (gap_s := _gap_s(event, confidence.first, confidence.last)) is not None
    ]
    fitted = learn(confidence.distribution, gaps_s)
    document = dict(declaration.as_json())
    clause = document["confidence"]
    document["confidence"] = {**(clause if isinstance(clause, dict) else {}), **fitted}
    return parse_declaration(document, declaration.name)


def _gap_s(event: Event, first: str, last: str) -> float | None:
    """From the first row bound to one variable to the last row bound to another [s]."""
    begins = [each.stamp for each in event.evidence if each.variable == first]
    ends = [each.stamp for each in event.evidence if each.variable == last]
    return (ends[-1] - begins[0]).total_seconds() if begins and ends else None
