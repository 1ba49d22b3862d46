"""The rules' half of the engine: steps in, events out, on event time; no I/O and no clock.

Intake (`semap/intake`) gives the steps of a map: rows that are due, in order, with up to where event time has
come; rows that cannot stand in the order; rules as they change (`step`). The rules of a map take them in turn
(`flow`), each with a state for each of its keys (`rule_run`) that a compiled program steps (`program`). What
is of one map needs no other, so that maps may be at work in different processes.

The engine promises:

- the same steps give the same events with the same ids in the same order, wherever watermarks cut the rows,
  and wherever the engine is stored and restored;
- rules that make an event of each row by itself take what cannot stand in the order as it comes;
- an unforeseen error in a rule puts that rule out of force, logged by its name, and the others go on.

`changes` says what is to be stored so that `restore` gives an engine that goes on in the same way. Nothing is
undone: whose commit fails restores the engine from what is stored.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from semap.errors import InvalidInput
from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.engine.changes import Changes, Late
from semap.rules.engine.map_engine import MapEngine
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import AsItComes, Due, MapGone, RuleChanged, Step
from semap.rules.row_json import RowJson, dump_row, load_row
from semap.timeline.stamp import to_us

log = logging.getLogger(__name__)


class Engine:
    """Mutable: the rules of all maps at work."""

    def __init__(self) -> None:
        self._maps: dict[int, MapEngine] = {}
        self._rules: dict[int, Rule] = {}
        self._gone: list[MapEngine] = []
        self._failed: set[int] = set()

    @property
    def rules(self) -> Mapping[int, Rule]:
        """All rules, by id, enabled or not."""
        return self._rules

    def change_rule(self, rule_id: int, rule: Rule | None) -> None:
        """A rule is added, replaced or (None) removed, for what follows. A new version begins without states.

        raises InvalidInput, and changes nothing, if it cannot be compiled or closes a circle of rules
        """
        known = self._rules.get(rule_id)
        if rule is not None:
            self._on(rule.map_id).change_rule(rule_id, rule)
            self._rules[rule_id] = rule
        elif known is not None:
            self._on(known.map_id).change_rule(rule_id, None)
            del self._rules[rule_id]

    def delete_map(self, map_id: int) -> None:
        """A map is gone, with its rules and all that waits."""
        if map_id not in self._maps:
            return
        gone = self._maps.pop(map_id)
        for rule_id in [rule_id for rule_id, rule in self._rules.items() if rule.map_id == map_id]:
            gone.change_rule(rule_id, None)
            del self._rules[rule_id]
        gone.waiting.clear()
        gone.late.clear()
        self._gone.append(gone)

    @property
    def given_up(self) -> Mapping[int, GivenUp]:
        """By rule, what its version gave up because too much was under way in a key."""
        return {rule_id: each for on_map in self._maps.values() for rule_id, each in on_map.given_up.items()}

    def failed(self) -> set[int]:
        """The rules that an error has put out of force since this was last asked."""
        failed, self._failed = self._failed, set()
        return failed

    def take(self, step: Step) -> list[Event]:
        """The events that a step makes."""
        match step:
            case MapGone(map_id):
                self.delete_map(map_id)
                return []
            case RuleChanged():
                return self._change(step)
            case Due(map_id, until_us, rows):
                on_map = self._on(map_id)
                events = on_map.take(rows, until_us)
            case AsItComes(map_id, row):
                on_map = self._on(map_id)
                events = on_map.take_as_it_comes(row)
        if on_map.failed:
            self._forget_failed(on_map)
        return events

    def _change(self, step: RuleChanged) -> list[Event]:
        """A rule is in force as it is now; its events of the rows that it begins with."""
        try:
            self.change_rule(step.rule_id, step.rule)
        except InvalidInput as error:
            log.error("Rule %d is not in force: %s", step.rule_id, error)
            self.change_rule(step.rule_id, None)
            self._failed.add(step.rule_id)
            return []
        if step.rows is None or step.rule is None or not step.rule.enabled:
            return []
        on_map = self._on(step.map_id)
        begun = on_map.begin(step.rule_id, step.rows)
        self._forget_failed(on_map)
        return [event for event in begun if to_us(event.stamp) >= step.from_us]

    def changes(self) -> Changes:
        """What is to be stored since the last call."""
        states: dict[tuple[int, str], object] = {}
        added: list[tuple[int, str, RowJson]] = []
        removed: list[tuple[int, str]] = []
        late: list[Late] = []
        for on_map in (*self._gone, *self._maps.values()):
            states.update(dict.fromkeys(on_map.dropped))
            on_map.dropped.clear()
            for rule_id, run in on_map.runs.items():
                states.update({(rule_id, text): document for text, document in run.changes()})
            new, gone = on_map.waiting.changes()
            added += [(on_map.map_id, row.uid, dump_row(row)) for row in new]
            removed += [(on_map.map_id, uid) for uid in gone]
            late += on_map.late
            on_map.late = []
        self._gone = []
        return Changes(states, added, removed, late)

    @staticmethod
    def restore(
        rules: Iterable[Rule],
        released_us: Mapping[int, int],
        states: Iterable[tuple[int, str, object]],
        pending: Iterable[tuple[int, object]],
        given_up: Mapping[int, GivenUp] = MappingProxyType({}),
    ) -> Engine:
        """That of which this was stored: rules, how far each map was, (rule, key, state), (map, row)."""
        engine = Engine()
        for rule in rules:
            engine.change_rule(rule.rule_id, rule)
        for map_id, us in released_us.items():
            engine._on(map_id).released_us = us
        for rule_id, text, state in states:
            if rule_id in engine._rules:
                engine._on(engine._rules[rule_id].map_id).load(rule_id, text, state)
        for on_map_id, row in pending:
            engine._on(on_map_id).waiting.load(load_row(row))
        for rule_id, each in given_up.items():
            if rule_id in engine._rules:
                engine._on(engine._rules[rule_id].map_id).note_given_up(rule_id, each)
        for on_map in engine._maps.values():
            engine._forget_failed(on_map)
            on_map.wake()
        return engine

    def _forget_failed(self, on_map: MapEngine) -> None:
        for rule_id in on_map.failed:
            del self._rules[rule_id]
        self._failed |= on_map.failed
        on_map.failed.clear()

    def _on(self, map_id: int) -> MapEngine:
        if map_id not in self._maps:
            self._maps[map_id] = MapEngine(map_id)
        return self._maps[map_id]
