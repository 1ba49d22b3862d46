"""The rules of one map at work: they take rows in order, and of each other the events."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence

from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.engine.changes import Late
from semap.rules.engine.flow import Flow
from semap.rules.engine.plan import plan_of
from semap.rules.engine.rule import Rule
from semap.rules.engine.rule_run import RuleRun, Timers
from semap.rules.engine.step import NEVER_US
from semap.rules.engine.waiting import Waiting, order_of
from semap.rules.row import Row

log = logging.getLogger(__name__)


class MapEngine:
    """Mutable.

    released_us  up to where rows have been taken
    waiting      events of the map's edits, which stand behind that
    late         events that came too late for some rule, since they were last asked for
    dropped      what states of rules that are no longer at work were stored under: (rule_id, key)
    failed       rules that an unforeseen error has put out of force, since they were last asked for
    """

    def __init__(self, map_id: int) -> None:
        self.map_id = map_id
        self.released_us = NEVER_US
        self.waiting = Waiting()
        self.late: list[Late] = []
        self.dropped: set[tuple[int, str]] = set()
        self.failed: set[int] = set()
        self._flow = Flow()
        self._waits, self._ordered = self._flow.plan.waiting(), self._flow.plan.ordered()
        self._rules: dict[int, Rule] = {}
        self._runs: dict[int, RuleRun] = {}
        self._given_up: dict[int, GivenUp] = {}

    @property
    def runs(self) -> Mapping[int, RuleRun]:
        return self._runs

    @property
    def given_up(self) -> Mapping[int, GivenUp]:
        """By rule, what its version gave up, also if the rule rests now."""
        at_work = {rule_id: run.given_up for rule_id, run in self._runs.items() if run.given_up is not None}
        return {**self._given_up, **at_work}

    def change_rule(self, rule_id: int, rule: Rule | None) -> None:
        """A rule is added, replaced or (None) removed; one that says the same goes on as it was.

        raises InvalidInput, and changes nothing, if it cannot be compiled or closes a circle of rules
        """
        if self._rules.get(rule_id) == rule:
            return
        run = RuleRun(rule, self._flow.timers) if rule is not None and rule.enabled else None
        self._put(rule_id, rule, run)

    def _put(self, rule_id: int, rule: Rule | None, run: RuleRun | None) -> None:
        rules = {known_id: known for known_id, known in self._rules.items() if known_id != rule_id}
        runs = {known_id: known for known_id, known in self._runs.items() if known_id != rule_id}
        if rule is not None:
            rules[rule_id] = rule
        if run is not None:
            runs[rule_id] = run
        self._flow.follow(plan_of(rules.values(), runs))
        if rule_id in self._runs:
            self.dropped.update((rule_id, text) for text in self._runs[rule_id].stored())
        self._waits, self._ordered = self._flow.plan.waiting(), self._flow.plan.ordered()
        known = self._rules.get(rule_id)
        given_up = self.given_up.get(rule_id) if rule and known and known.version == rule.version else None
        self._rules, self._runs = rules, runs
        self.note_given_up(rule_id, given_up)

    def note_given_up(self, rule_id: int, given_up: GivenUp | None) -> None:
        """What a version of a rule gave up before it was put to work here."""
        self._given_up.pop(rule_id, None)
        if given_up is None:
            return
        run = self._runs.get(rule_id)
        if run is None:
            self._given_up[rule_id] = given_up
        else:
            run.add_given_up(given_up)

    def take_as_it_comes(self, row: Row) -> list[Event]:
        """Give a row to the rules that need no order."""
        if row.source == "object_state" and row.values.get("previous") == row.values["type"]:
            return []
        events = []
        for run in self._flow.plan.as_come[row.source].get(row.values["input"], ()):  # type: ignore[call-overload]
            try:
                made = [(run.maker.event(key, match), match) for key, match in run.take(row)]
            except Exception as error:  # whatever it is, it is this rule's alone
                self.fail(run, error)
                continue
            for event, match in made:
                events.append(event)
                if run.rule.name in self._flow.plan.of_events:
                    events += self._hear(run.maker.row(event, match, row.stamp_us))
        return events

    def _hear(self, row: Row) -> list[Event]:
        """An event of a row that came as it did: it waits as that does, or is as late."""
        name, source = row.values["input"], row.source
        if row.stamp_us > self.released_us:
            if name in self._waits[source]:
                self.waiting.add(row)
            return []
        if name in self._ordered[source]:
            self.late.append(Late(self.map_id, row, self.released_us))
        return self.take_as_it_comes(row)

    def take(self, rows: Sequence[Row], until_us: int) -> list[Event]:
        """Take these rows, which are due and in order, and all that time brings up to `until_us`."""
        own = self.waiting.until(until_us)
        events = self._flow.take(sorted((*rows, *own), key=order_of) if own else rows, until_us)
        for run, error in self._flow.failed:
            self.fail(run, error)
        self._flow.failed.clear()
        self.waiting.remove_until(until_us)
        self.released_us = until_us
        return events

    def fail(self, run: RuleRun, error: Exception) -> None:
        """Put a rule out of force until it is declared or enabled anew, so that the others go on."""
        log.error("Rule %s is put out of force, since it failed:", run.rule.name, exc_info=error)
        run.end()
        self.failed.add(run.rule.rule_id)
        self._put(run.rule.rule_id, None, None)

    def begin(self, rule_id: int, rows: Iterable[Row]) -> list[Event]:
        """Let a rule begin anew with these rows, in any order; gives the events that it makes of them.

        Those that other rules have passed are taken now, by this rule alone; the others wait.
        """
        run = RuleRun(self._rules[rule_id], Timers())
        alone = Flow()
        alone.follow(plan_of(self._rules.values(), {rule_id: run}))
        ordered = sorted(rows, key=order_of)
        released_us = self.released_us
        alone.timers = Timers()
        run.move_to(alone.timers)
        passed = [row for row in ordered if row.stamp_us <= released_us]
        events = alone.take(passed, released_us)
        if alone.failed:
            self.fail(*alone.failed[0])
            return events
        run.move_to(self._flow.timers)
        self._put(rule_id, run.rule, run)
        for row in ordered:
            if row.stamp_us > released_us and row.values["input"] in self._waits[row.source]:
                self.waiting.add(row)
        return events

    def load(self, rule_id: int, text: str, document: object) -> None:
        """Take what was stored of a rule's state."""
        if rule_id not in self._runs:
            return
        try:
            self._runs[rule_id].load(text, document)
        except Exception as error:  # a state of another release, say
            self.dropped.add((rule_id, text))
            self.fail(self._runs[rule_id], error)

    def wake(self) -> None:
        """Once all states and rows are loaded."""
        for run in self._runs.values():
            run.move_to(self._flow.timers)
