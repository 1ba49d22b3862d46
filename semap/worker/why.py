"""Why a rule made an event, or why it made none, out of stored history: for people, and as a certificate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from math import isinf
from typing import Any

import psycopg

from semap.intake.backfill import looks_back
from semap.intake.history_rows import Span as Read
from semap.rules.declaration import Declaration
from semap.rules.engine.partition import part_of
from semap.rules.engine.preparation import Preparation
from semap.rules.explanation.certifying import Span, counts_from_begin
from semap.rules.explanation.certifying import certify as certify_rows
from semap.rules.explanation.explanation import NEAR_US, Explanation
from semap.rules.explanation.explanation import explain as explain_rows
from semap.rules.explanation.moment import Moment
from semap.rules.lookback import lookback_us
from semap.timeline.stamp import to_datetime, to_us
from semap.worker.past import past_of_map

UNBOUND_US = 3_600_000_000
"""So far around the moment a rule without a window is looked at."""
RECENT_US = 600_000_000
"""What is older than the newest source by this is not new."""


def explain(
    connection: psycopg.Connection,
    map_name: str,
    declaration: Declaration,
    at: datetime,
    key: Mapping[str, object],
    most_rows: int | None = None,
) -> Explanation:
    """What a rule found of a key around a moment, or how far it came.

    key     for each property of `partition_by` its value, by names: {"room": "Room07"}
    raises  NotFound if there is no such map, InvalidInput if the key is not that of the rule, or what it
            reads was dropped, TooLarge if there are more than `most_rows` in a table
    """
    past = past_of_map(connection, map_name)
    rule = past.rule(declaration)
    past.require_kept(rule, at)
    window_us = lookback_us([declaration])
    reach_us = UNBOUND_US if isinf(window_us) else int(window_us) + NEAR_US
    at_us = to_us(at)
    # a match around the moment begins one window before it, and the one that it could not overlap before that
    held = looks_back(declaration)
    span = Read(at_us - 2 * reach_us, at_us + reach_us, with_held=held, most_rows=most_rows)
    known_us = min(past.heard_us or 0, at_us + reach_us)
    return explain_rows(declaration, past.rows(rule, span), at_us, key, known_us)


def certify(
    connection: psycopg.Connection,
    map_name: str,
    declaration: Declaration,
    span: tuple[datetime, datetime],
    key: Mapping[str, object],
    version: int | None = None,
    most_rows: int | None = None,
) -> dict[str, object]:
    """The certificate of what a rule found in a span, or how far it came; semap.certificate checks it.

    span    both ends included; one moment is its whole second, where it is given to the second
    key     only of keys with these names: {"room": "Room07"}; of all, where it names none
    raises  as `explain`
    """
    past = past_of_map(connection, map_name)
    rule = past.rule(declaration)
    start, end = span
    past.require_kept(rule, start)
    from_us, until_us = to_us(start), Moment.at(to_us(end)).until_us if start == end else to_us(end)
    span_us = Span(from_us, until_us, past.heard_us or 0)
    read = _read(declaration, span_us, most_rows)
    span_us = replace(span_us, known_us=min(span_us.known_us, read.until_us or 0))
    rows = [row for row in past.rows(rule, read) if row.stamp_us <= span_us.known_us]
    about = {"map": map_name, "version": version}
    return certify_rows(declaration, rows, span_us, key, about)


def certificate_is_stored(
    connection: psycopg.Connection, map_name: str, declaration: Declaration, document: Mapping[str, Any]
) -> bool:
    """Whether what is stored up to then gives this certificate of the same span and keys."""
    span = Span(document["from_us"], document["until_us"], document["known_us"])
    past = past_of_map(connection, map_name)
    rule = past.rule(declaration)
    rows = past.rows(rule, _read(declaration, span))
    kept = [row for row in rows if row.stamp_us <= span.known_us]
    found = certify_rows(declaration, kept, span, document["key"])
    return bool(found["streams"] == document["streams"])


def _read(declaration: Declaration, span: Span, most_rows: int | None = None) -> Read:
    """The stored rows that a certificate of a span may rest on."""
    window_us = lookback_us([declaration])
    reach_us = UNBOUND_US if isinf(window_us) else int(window_us) + NEAR_US
    begin_us = None if counts_from_begin(declaration) else span.from_us - 2 * reach_us
    return Read(begin_us, span.until_us + reach_us, with_held=looks_back(declaration), most_rows=most_rows)


def explain_newest(
    connection: psycopg.Connection,
    map_name: str,
    declaration: Declaration,
    after_us: int | None = None,
    most_rows: int | None = None,
) -> Explanation | None:
    """What a rule made of the newest row that it read, or why it made nothing of it.

    after_us  None is given where no row is newer
    raises    as `explain`
    """
    past = past_of_map(connection, map_name)
    if past.heard_us is None:
        return None
    from_us = max(past.heard_us - RECENT_US, -UNBOUND_US if after_us is None else after_us + 1)
    rows = past.rows(past.rule(declaration), Read(from_us, None, most_rows=most_rows))
    preparation = Preparation(declaration)
    taken = [each for came in rows for each in preparation.rows(came)]
    for row in sorted(taken, key=lambda each: each.order, reverse=True):
        key = {name: part_of(row.values, name.split(".")) for name in declaration.partition_by}
        if None not in key.values():
            return explain(connection, map_name, declaration, to_datetime(row.stamp_us), key, most_rows)
    return None
