"""Rules alone over rows that are all there: a dry run, the past, a span that is computed again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import groupby

from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.engine.engine import Engine
from semap.rules.engine.rule import Rule
from semap.rules.engine.waiting import stamp_of
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
    kept = [row for row in rows if row.stamp_us <= until_us]
    for map_id in sorted(map_ids):
        for together in _in_turn(kept):
            for row in together:
                engine.arrive(map_id, row)
            engine.watermark(map_id, 0, together[-1].stamp_us)
            events += engine.release()
            watch(len(events))
        engine.watermark(map_id, 0, until_us)
        events += engine.release()
    for rule_id, given_up in engine.given_up.items():
        tell(engine.rules[rule_id], given_up)
    return events


def _in_turn(rows: Iterable[Row]) -> Iterator[list[Row]]:
    """Rows by their stamps, some at a time; those of one stamp are together."""
    together: list[Row] = []
    for _, of_stamp in groupby(sorted(rows, key=stamp_of), key=stamp_of):
        together += of_stamp
        if len(together) >= ROWS_AT_ONCE:
            yield together
            together = []
    if together:
        yield together
