"""Both halves of the engine as a worker has them, and what it stores of them, in memory and as JSON texts."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping

from semap.intake.intake import Intake
from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.engine import engine as rules_half
from semap.rules.engine.changes import Changes, Late
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import Due, MapGone, RuleChanged, Step
from semap.rules.row import Row
from semap.worker.progress import halves


class Engine:
    """Rows in, events out."""

    def __init__(self) -> None:
        self.intake, self.half = Intake(), rules_half.Engine()

    @property
    def rules(self) -> Mapping[int, Rule]:
        assert self.intake.rules == self.half.rules
        return self.half.rules

    @property
    def given_up(self) -> Mapping[int, GivenUp]:
        return self.half.given_up

    def change_rule(self, rule_id: int, rule: Rule | None) -> None:
        self.half.change_rule(rule_id, rule)
        self.intake.change_rule(rule_id, rule)

    def delete_map(self, map_id: int) -> None:
        self.intake.delete_map(map_id)
        self._take(MapGone(map_id))

    def arrive(self, map_id: int, row: Row) -> list[Event]:
        step = self.intake.arrive(map_id, row)
        return [] if step is None else self._take(step)

    def retract(self, map_id: int, uid: str, row: Row) -> None:
        self.intake.retract(map_id, uid, row)

    def watermark(self, map_id: int, source_id: int, complete_us: int, is_awaited: bool = True) -> None:
        self.intake.watermark(map_id, source_id, complete_us, is_awaited)

    def due(self) -> list[Due]:
        return self.intake.due()

    def take(self, dues: Iterable[Due]) -> list[Event]:
        return [event for due in dues for event in self._take(due)]

    def release(self) -> list[Event]:
        return self.take(self.due())

    def begin(self, rule_id: int, rows: Iterable[Row]) -> list[Event]:
        rule = self.rules[rule_id]
        return self._take(RuleChanged(rule.map_id, rule_id, rule, self.intake.begin(rule.map_id, rows)))

    def changes(self) -> Changes:
        return self.intake.changes() + self.half.changes()

    @staticmethod
    def restore(rules: Iterable[Rule], watermarks, states, pending, given_up=None) -> Engine:
        engine, known = Engine(), list(rules)
        of_intake, of_rules = halves(pending)
        engine.intake = Intake.restore(known, watermarks, of_intake)
        released_us = {int(map_id): mark["released_us"] for map_id, mark in watermarks.items()}
        engine.half = rules_half.Engine.restore(known, released_us, states, of_rules, given_up or {})
        engine._forget_failed()
        return engine

    def _take(self, step: Step) -> list[Event]:
        events = self.half.take(step)
        self._forget_failed()
        return events

    def _forget_failed(self) -> None:
        for rule_id in self.half.failed():
            self.intake.change_rule(rule_id, None)


class EngineStore:
    """Takes what an engine gives to be stored, and restores the engine from it."""

    def __init__(self) -> None:
        self.states: dict[tuple[int, str], str] = {}
        self.pending: dict[tuple[int, str], str] = {}
        self.late: list[Late] = []
        self.progress = ("{}", "{}", "{}")

    def take(self, engine: Engine) -> None:
        changes = engine.changes()
        for key, state in changes.states.items():
            if state is None:
                self.states.pop(key, None)
            else:
                self.states[key] = json.dumps(state)
        for map_id, uid in changes.pending_removed:
            del self.pending[map_id, uid]
        for map_id, uid, row in changes.pending_added:
            assert (map_id, uid) not in self.pending
            self.pending[map_id, uid] = json.dumps(row)
        self.late += changes.late
        given_up = {rule_id: each.as_json() for rule_id, each in engine.given_up.items()}
        self.progress = tuple(
            map(json.dumps, (engine.intake.rules_json(), engine.intake.watermarks_json(), given_up))
        )

    def restored(self) -> Engine:
        rules, watermarks, given_up = map(json.loads, self.progress)
        return Engine.restore(
            [Rule.from_json(int(rule_id), document) for rule_id, document in rules.items()],
            watermarks,
            [(rule_id, key, json.loads(state)) for (rule_id, key), state in self.states.items()],
            [(map_id, json.loads(row)) for (map_id, _), row in self.pending.items()],
            {int(rule_id): GivenUp.from_json(each) for rule_id, each in given_up.items()},
        )
