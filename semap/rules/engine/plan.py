"""Which rules of a map read which rows, in which order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

from semap.rules.engine.rule import Rule
from semap.rules.engine.rule_order import order_of_rules
from semap.rules.needs import needs_no_order
from semap.rules.row import RANKS, Source

SOURCES: tuple[Source, ...] = tuple(RANKS)

AtWork = TypeVar("AtWork")
"""What stands for a rule in force: what runs it, or where nothing does, its id."""
Readers: TypeAlias = Mapping[Source, Mapping[str, tuple[AtWork, ...]]]
"""By what a row is and the name of its input."""


@dataclass(frozen=True)
class Plan(Generic[AtWork]):
    """The rules in force on a map, those that are read before those that read them.

    in_order   take rows as they are released, each before the next
    in_moment  take the released rows of one stamp together, after the rules that they read: they read events
    as_come    need no order, and take rows that cannot stand in it as they come: of the map, and too late
    of_events  read the events of a rule, by its name
    """

    runs: tuple[AtWork, ...]
    in_order: Readers[AtWork]
    in_moment: Readers[AtWork]
    as_come: Readers[AtWork]
    of_events: Mapping[str, tuple[AtWork, ...]]

    def waiting(self) -> Mapping[Source, frozenset[str]]:
        """The inputs whose rows wait for the watermark."""
        return {source: frozenset((*self.in_order[source], *self.in_moment[source])) for source in SOURCES}

    def ordered(self) -> Mapping[Source, frozenset[str]]:
        """The inputs that are read by rules which cannot take a row that comes too late."""
        return {
            source: frozenset(
                name
                for table in (self.in_order[source], self.in_moment[source])
                for name, runs in table.items()
                if not set(runs) <= set(self.as_come[source].get(name, ()))
            )
            for source in SOURCES
        }

    def names(self, source: Source) -> frozenset[str]:
        """The inputs of one kind that are read."""
        return frozenset((*self.in_order[source], *self.in_moment[source], *self.as_come[source]))


def plan_of(rules: Iterable[Rule], runs: Mapping[int, AtWork]) -> Plan[AtWork]:
    """The plan for all rules of a map, of which `runs` holds those at work.

    raises InvalidInput if rules read one another in a circle
    """
    known = {rule.name: rule for rule in rules}
    read = {name: _inputs_of(rule, frozenset(known)) for name, rule in known.items()}
    order = order_of_rules(
        {name: [each for source, each in inputs if source == "event"] for name, inputs in read.items()}
    )
    at_work = [(known[name], runs[known[name].rule_id]) for name in order if known[name].rule_id in runs]
    tables: list[dict[Source, dict[str, tuple[AtWork, ...]]]] = [
        {source: {} for source in SOURCES} for _ in range(3)
    ]
    in_order, in_moment, as_come = tables
    of_events: dict[str, tuple[AtWork, ...]] = {}
    for rule, run in at_work:
        inputs = read[rule.name]
        table = in_moment if any(source == "event" for source, _ in inputs) else in_order
        is_free = needs_no_order(rule.declaration)
        for source, name in inputs:
            if is_free:
                as_come[source][name] = (*as_come[source].get(name, ()), run)
            if not is_free or source != "map":
                table[source][name] = (*table[source].get(name, ()), run)
            if source == "event":
                of_events[name] = (*of_events.get(name, ()), run)
    return Plan(tuple(run for _, run in at_work), in_order, in_moment, as_come, of_events)


def _inputs_of(rule: Rule, names: frozenset[str]) -> frozenset[tuple[Source, str]]:
    return frozenset((rule.source_of(item, names), item.name) for item in rule.declaration.inputs)
