"""Stored history as the rows that a rule reads: changes of relations, states of objects, events of rules.

Changes of the map are not among them: history keeps what was changed, but not when it was committed. Nor are
changes of relations that were taken back.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

import psycopg
from psycopg.rows import dict_row

from semap.errors import TooLarge
from semap.intake.input_row import READERS, RELATION_COLUMNS, event_row, event_text
from semap.intake.map_facts import MapFacts
from semap.model.event import Event
from semap.rules.engine.rule import Rule
from semap.rules.row import Row, Source
from semap.store.database.connection import translated
from semap.timeline.stamp import to_datetime, to_us

SINCE_EVER = datetime(1800, 1, 1, tzinfo=UTC)
FOR_EVER = datetime(9999, 1, 1, tzinfo=UTC)
EARLIEST_US, LATEST_US = to_us(SINCE_EVER), to_us(FOR_EVER)

TABLES: Mapping[Source, str] = {
    "relation": "relation_change",
    "object_state": "object_state",
    "event": "event",
}
STATEMENTS: Mapping[Source, str] = {
    "relation": f"""
        select {RELATION_COLUMNS}
        from semap.relation_change c
        where c.map_id = %(map_id)s and c.query_name = any (%(names)s)
          and c.stamp between %(first)s and %(last)s and c.received_at >= %(received_from)s
          and (c.change_id <= %(change_id)s or %(change_id)s is null)
          and c.amendment is distinct from 'retracted'
          and not exists (select from semap.relation_change d where d.retracts = c.uid
                          and (d.change_id <= %(change_id)s or %(change_id)s is null))
    """,  # noqa: S608  (a constant)
    "object_state": """
        select o.uid::text, o.property, o.value, b.value as previous, o.instance_id::text, o.instance_name,
               o.stamp::text, b.since::text, o.attributes::text
        from semap.object_state o
        left join lateral semap.object_state_before(o.instance_id, o.property, o.stamp, o.value) b on true
        where o.value is distinct from b.value and o.map_id = %(map_id)s and o.property = any (%(names)s)
          and o.stamp between %(first)s and %(last)s and o.received_at >= %(received_from)s
          and (o.object_state_id <= %(object_state_id)s or %(object_state_id)s is null)
    """,
    "event": """
        select event_id::text, rule_name, type, cause, track_id::text, track_name, instance_id::text,
               instance_name, stamp::text, since::text, measures::text, confidence::text
        from semap.event e
        where e.map_id = %(map_id)s and e.rule_name = any (%(names)s)
          and e.stamp between %(first)s and %(last)s and e.created_at >= %(received_from)s
          and not exists (select from semap.event_amendment a
                          where a.event_id = e.event_id and a.verdict in ('retracted', 'amended'))
    """,
}
# what held when the first row came: relations that had begun and not ended, the last state of each object
HELD: Mapping[Source, str] = {
    "relation": f"""
        select distinct on (query_id, track_id, subject_instance_id, instance_id, object_track_id)
               {RELATION_COLUMNS}
        from semap.relation_change c
        where c.map_id = %(map_id)s and c.query_name = any (%(names)s) and c.stamp < %(first)s
          and c.kind <> 'crossed' and (c.change_id <= %(change_id)s or %(change_id)s is null)
          and c.amendment is distinct from 'retracted'
          and not exists (select from semap.relation_change d where d.retracts = c.uid
                          and (d.change_id <= %(change_id)s or %(change_id)s is null))
        order by query_id, track_id, subject_instance_id, instance_id, object_track_id, c.stamp desc,
                 c.transition_at desc, c.cause = 'disappeared' desc, c.change_id desc
    """,  # noqa: S608  (a constant)
    "object_state": """
        select distinct on (c.instance_id, c.property)
               c.uid::text, c.property, c.value, c.previous_value as previous, c.instance_id::text,
               c.instance_name, c.stamp::text, c.previous_stamp::text as since, c.attributes::text
        from (
          select s.*, lag(s.value) over one_object as previous_value,
                 lag(s.stamp) over one_object as previous_stamp
          from (
            select o.*, lag(o.value) over each_state as before
            from semap.object_state o
            where o.map_id = %(map_id)s and o.property = any (%(names)s) and o.stamp < %(first)s
              and (o.object_state_id <= %(object_state_id)s or %(object_state_id)s is null)
            window each_state as (partition by o.instance_id, o.property order by o.stamp, o.uid)) s
          where s.value is distinct from s.before
          window one_object as (partition by s.instance_id, s.property order by s.stamp, s.uid)) c
        order by c.instance_id, c.property, c.stamp desc, c.uid desc
    """,
}


@dataclass(frozen=True)
class Span:
    """Which rows of the past.

    from_us, until_us  stamps, both included; None is without bound
    seam               the last rows that count, by the names of their ids; None: all that are stored
    received_from      rows that came earlier do not count
    with_held          also what began before and holds where the span begins
    most_rows          more of one table are refused
    """

    from_us: int | None = None
    until_us: int | None = None
    seam: Mapping[str, int] | None = None
    received_from: datetime = SINCE_EVER
    with_held: bool = False
    most_rows: int | None = None


def history_rows(
    connection: psycopg.Connection, rule: Rule, rule_names: frozenset[str], span: Span, facts: MapFacts
) -> list[Row]:
    """The rows of a rule's inputs in a span, in order.

    rule_names  of the map's rules, by which an input is told from a property of an object
    raises      TooLarge if there are more than the span allows
    """
    rows: list[Row] = []
    for source, names in _inputs(rule, rule_names).items():
        wanted = _parameters(rule.map_id, names, span)
        rows += _read(connection, source, STATEMENTS[source], wanted, facts)
        if span.with_held and span.from_us is not None and source in HELD:
            held = _read(connection, source, HELD[source], wanted, facts)
            rows += [row for row in held if row.values["type"] != "ended" or source != "relation"]
    return sorted(rows, key=lambda row: row.order)


def unwritten_rows(
    rule: Rule, rule_names: frozenset[str], span: Span, events: Iterable[Event], facts: MapFacts
) -> Iterator[Row]:
    """The rows of a rule's inputs in a span that events are which are made and not yet stored."""
    names = _inputs(rule, rule_names).get("event", [])
    first, last = _bounds(span)
    for event in events:
        if event.map_id == rule.map_id and event.rule_name in names and first <= event.stamp <= last:
            yield event_row(event_text(event), facts)


def _inputs(rule: Rule, rule_names: frozenset[str]) -> dict[Source, list[str]]:
    inputs: dict[Source, list[str]] = {}
    for item in rule.declaration.inputs:
        source = rule.source_of(item, rule_names)
        if source in STATEMENTS:
            inputs.setdefault(source, []).append(item.name)
    return inputs


def _parameters(map_id: int, names: list[str], span: Span) -> dict[str, object]:
    seam = span.seam or {}
    first, last = _bounds(span)
    return {
        "map_id": map_id,
        "names": names,
        "first": first,
        "last": last,
        "received_from": span.received_from,
        "limit": None if span.most_rows is None else span.most_rows + 1,
        "change_id": seam.get("change_id"),
        "object_state_id": seam.get("object_state_id"),
    }


def _bounds(span: Span) -> tuple[datetime, datetime]:
    return (
        SINCE_EVER if span.from_us is None else _stamp(span.from_us),
        FOR_EVER if span.until_us is None else _stamp(span.until_us),
    )


def _stamp(stamp_us: int) -> datetime:
    """The stamp, or the nearest one that may be stored."""
    return to_datetime(min(max(stamp_us, EARLIEST_US), LATEST_US))


def _read(
    connection: psycopg.Connection,
    source: Source,
    statement: str,
    wanted: Mapping[str, object],
    facts: MapFacts,
) -> Iterable[Row]:
    read = READERS[TABLES[source]]
    with translated(), connection.cursor(row_factory=dict_row) as cursor:
        cursor.execute(f"{statement} limit %(limit)s", wanted)
        if wanted["limit"] is not None and cursor.rowcount == wanted["limit"]:
            raise TooLarge(
                f"There are more than {cursor.rowcount - 1} rows to read.", "Choose a shorter span."
            )
        return [read(found, facts) for found in cursor]
