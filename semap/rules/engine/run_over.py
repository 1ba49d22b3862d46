"""Rules alone over rows that are all there: a dry run, the past, a span that is computed again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import groupby

from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.engine.engine import Engine
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import AsItComes, Due
from semap.rules.engine.waiting import in_order, stamp_of
from semap.rules.row import Row

ROWS_AT_ONCE = 20
"""So few, since a row may make thousands of events, and `watch` is to hear of them soon."""


def run_over(
    rules: Iterable[Rule],
    rows: Iterable[Row],
    until_us: int,
    watch: Callable[[int], None] = lambda count: None,
    tell: Callable[[Rule, GivenUp], None] = lambda rule, given_up: None,
) -> list[Event]:
    """The events, in order, that rules of one map make of rows in any order and of time, up to `until_us`.

    watch   is told again and again how many events there are, and ends the run by raising
    tell    is told at the end of what a rule gave up, because too much was under way in a key
    raises  InvalidInput as `Engine.change_rule`
    """
    engine = Engine()
    map_ids = set()
    for rule in rules:
        engine.change_rule(rule.rule_id, rule)
        map_ids.add(rule.map_id)
    events: list[Event] = []
    kept = in_order({row.uid: row for row in rows if row.stamp_us <= until_us}.values())
    for map_id in sorted(map_ids):
        for together in _some_at_a_time(kept):
            for row in together:
                if row.source == "map":
                    events += engine.take(AsItComes(map_id, row))
            events += engine.take(Due(map_id, together[-1].stamp_us, together))
            watch(len(events))
        events += engine.take(Due(map_id, until_us, ()))
    for rule_id, given_up in engine.given_up.items():
        tell(engine.rules[rule_id], given_up)
    return events


def _some_at_a_time(rows: Iterable[Row]) -> Iterator[list[Row]]:
    """Rows in order; those of one stamp are together."""
    together: list[Row] = []
    for _, of_stamp in groupby(rows, key=stamp_of):
        together += of_stamp
        if len(together) >= ROWS_AT_ONCE:
            yield together
            together = []
    if together:
        yield together
