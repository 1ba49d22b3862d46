"""Which rules of a map read which rows, in which order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from semap.rules.engine.rule import Rule
from semap.rules.engine.rule_order import order_of_rules
from semap.rules.engine.rule_run import RuleRun
from semap.rules.needs import Needs, needs_no_order, needs_of
from semap.rules.row import RANKS, Source

SOURCES: tuple[Source, ...] = tuple(RANKS)

Readers: TypeAlias = Mapping[Source, Mapping[str, tuple[RuleRun, ...]]]
"""By what a row is and the name of its input."""


@dataclass(frozen=True)
class Plan:
    """The rules in force on a map, those that are read before those that read them.

    in_order   take rows as they are released, each before the next
    in_moment  take the released rows of one stamp together, after the rules that they read: they read events
    as_come    need no order, and take rows that cannot stand in it as they come: of the map, and too late
    of_events  read the events of a rule, by its name
    """

    runs: tuple[RuleRun, ...]
    in_order: Readers
    in_moment: Readers
    as_come: Readers
    of_events: Mapping[str, tuple[RuleRun, ...]]

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

    def needs(self) -> Needs:
        """What rows need before they are taken."""
        needs = Needs()
        for run in self.runs:
            needs |= needs_of(run.rule.declaration)
        return needs

    def queries(self) -> Mapping[int, str]:
        """The continuous queries that are read, by id."""
        return {
            run.rule.queries[item.name]: item.name
            for run in self.runs
            for item in run.rule.declaration.inputs
            if item.name in run.rule.queries
        }

    def names(self, source: Source) -> frozenset[str]:
        """The inputs of one kind that are read."""
        return frozenset((*self.in_order[source], *self.in_moment[source], *self.as_come[source]))


def plan_of(rules: Iterable[Rule], runs: Mapping[int, RuleRun]) -> Plan:
    """The plan for all rules of a map, of which `runs` holds those at work; sets their places.

    raises InvalidInput if rules read one another in a circle
    """
    known = {rule.name: rule for rule in rules}
    read = {name: _inputs_of(rule, frozenset(known)) for name, rule in known.items()}
    order = order_of_rules(
        {name: [each for source, each in inputs if source == "event"] for name, inputs in read.items()}
    )
    at_work = tuple(runs[known[name].rule_id] for name in order if known[name].rule_id in runs)
    in_order, in_moment, as_come = _no_readers(), _no_readers(), _no_readers()
    of_events: dict[str, tuple[RuleRun, ...]] = {}
    for place, run in enumerate(at_work):
        run.place = place
        inputs = read[run.rule.name]
        table = in_moment if any(source == "event" for source, _ in inputs) else in_order
        is_free = needs_no_order(run.rule.declaration)
        for source, name in inputs:
            if is_free:
                as_come[source][name] = (*as_come[source].get(name, ()), run)
            if not is_free or source != "map":
                table[source][name] = (*table[source].get(name, ()), run)
            if source == "event":
                of_events[name] = (*of_events.get(name, ()), run)
    return Plan(at_work, in_order, in_moment, as_come, of_events)


def _inputs_of(rule: Rule, names: frozenset[str]) -> frozenset[tuple[Source, str]]:
    return frozenset((rule.source_of(item, names), item.name) for item in rule.declaration.inputs)


def _no_readers() -> dict[Source, dict[str, tuple[RuleRun, ...]]]:
    return {source: {} for source in SOURCES}
