"""What a worker stores of an engine, in memory and as JSON texts."""

from __future__ import annotations

import json

from semap.model.given_up import GivenUp
from semap.rules.engine.engine import Engine
from semap.rules.engine.map_engine import Late
from semap.rules.engine.rule import Rule


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
        self.progress = tuple(map(json.dumps, (engine.rules_json(), engine.watermarks_json(), given_up)))

    def restored(self) -> Engine:
        rules, watermarks, given_up = map(json.loads, self.progress)
        return Engine.restore(
            [Rule.from_json(int(rule_id), document) for rule_id, document in rules.items()],
            watermarks,
            [(rule_id, key, json.loads(state)) for (rule_id, key), state in self.states.items()],
            [(map_id, json.loads(row)) for (map_id, _), row in self.pending.items()],
            {int(rule_id): GivenUp.from_json(each) for rule_id, each in given_up.items()},
        )
