"""Why a rule made an event at a moment, or why it made none, out of stored history."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from math import isinf

import psycopg

from semap.rules.declaration import Declaration
from semap.rules.explanation.explanation import NEAR_US, Explanation
from semap.rules.explanation.explanation import explain as explain_rows
from semap.rules.lookback import lookback_us
from semap.timeline.stamp import to_us
from semap.worker.backfill import looks_back
from semap.worker.history_rows import Span
from semap.worker.past import past_of_map

UNBOUND_US = 3_600_000_000
"""So far around the moment a rule without a window is looked at."""


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
    span = Span(at_us - 2 * reach_us, at_us + reach_us, with_held=held, most_rows=most_rows)
    known_us = min(past.heard_us or 0, at_us + reach_us)
    return explain_rows(declaration, past.rows(rule, span), at_us, key, known_us)
