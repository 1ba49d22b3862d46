"""The rules of one map, fed by records, in whichever process: text in, text out, and a state of text.

The state is entries, each a text under a name, which whoever runs this keeps:

    at/SHARD         place in the log of the last record that was taken
    part/SHARD/N     a part of one that is not whole yet
    map              map_id and up to where rows have been taken
    rule/ID          a rule; given_up/ID  what it gave up
    state/ID/KEY     what it has under way in a key
    row/UID          an event of a rule that waits

The same records give the same events, doubled or not, wherever it is made anew of its entries.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping

from semap.model.given_up import GivenUp
from semap.rules.engine.changes import Changes
from semap.rules.engine.engine import Engine
from semap.rules.engine.event_document import event_json
from semap.rules.engine.record import Handed, Head, load_steps, split_head
from semap.rules.engine.rule import Rule
from semap.rules.engine.step import NEVER_US, Due, MapGone, RuleChanged


class MapRules:
    """Mutable; `take` records, then ask for `changes` before they are committed."""

    def __init__(self, entries: Mapping[str, str]) -> None:
        self._changed: dict[str, str | None] = {}
        self._names = set(entries)
        self._at = {name[3:]: int(text) for name, text in entries.items() if name.startswith("at/")}
        self._parts = {name: text for name, text in entries.items() if name.startswith("part/")}
        self._open(entries)

    def take(self, text: str) -> list[str]:
        """What a record, or the last part of one, makes: JSON of events and of late rows, one each."""
        head, rest = split_head(text)
        whole = self._whole(head, rest)
        if whole is None or head.lsn <= self._at.get(head.shard, -1):
            return []
        made: list[dict[str, object]] = []
        for step in load_steps(whole):
            if isinstance(step, Handed):
                self._become(step.entries)
                continue
            if isinstance(step, MapGone):
                self._become({})
                continue
            if isinstance(step, Due):
                self._released_us = step.until_us
            self._map_id = step.map_id
            made += ({"event": event_json(event)} for event in self._engine.take(step))
            if isinstance(step, RuleChanged):
                self._set(
                    f"rule/{step.rule_id}", None if step.rule is None else json.dumps(step.rule.as_json())
                )
            for rule_id in self._engine.failed():
                self._set(f"rule/{rule_id}", None)
        self._at[head.shard] = head.lsn
        self._set(f"at/{head.shard}", str(head.lsn))
        made += self._note(self._engine.changes())
        told = {"map_uid": head.map_uid, "shard": head.shard}
        return [json.dumps({**told, **each}) for each in made]

    def changes(self) -> Mapping[str, str | None]:
        """The entries that changed since this was last asked; None: to be deleted."""
        changed, self._changed = self._changed, {}
        return changed

    def _open(self, entries: Mapping[str, str]) -> None:
        self._map_id, self._released_us = json.loads(entries.get("map", f"[0, {NEVER_US}]"))
        rules: list[Rule] = []
        states: list[tuple[int, str, object]] = []
        rows: list[tuple[int, object]] = []
        given_up: dict[int, GivenUp] = {}
        for name, text in entries.items():
            kind, _, rest = name.partition("/")
            match kind:
                case "rule":
                    rules.append(Rule.from_json(int(rest), json.loads(text)))
                case "state":
                    number, _, key = rest.partition("/")
                    states.append((int(number), key, json.loads(text)))
                case "row":
                    rows.append((self._map_id, json.loads(text)))
                case "given_up":
                    given_up[int(rest)] = GivenUp.from_json(json.loads(text))
        self._engine = Engine.restore(rules, {self._map_id: self._released_us}, states, rows, given_up)
        for rule_id in self._engine.failed():
            self._set(f"rule/{rule_id}", None)

    def _become(self, entries: Mapping[str, str]) -> None:
        """Forget all but the place, and be what is said."""
        for name in [name for name in self._names if not name.startswith(("at/", "part/"))]:
            self._set(name, None)
        for name, text in entries.items():
            self._set(name, text)
        self._open(entries)

    def _whole(self, head: Head, rest: str) -> str | None:
        """A record once its last part is there."""
        if head.parts == 1:
            return rest
        if head.part == 1:
            self._drop_parts(head.shard)
        elif f"part/{head.shard}/{head.part - 1}" not in self._parts:
            return None  # of a record that was whole before
        self._parts[f"part/{head.shard}/{head.part}"] = rest
        if head.part < head.parts:
            self._set(f"part/{head.shard}/{head.part}", rest)
            return None
        whole = "".join(self._parts[f"part/{head.shard}/{part}"] for part in range(1, head.parts + 1))
        self._drop_parts(head.shard)
        return whole

    def _drop_parts(self, shard: str) -> None:
        for name in [name for name in self._parts if name.startswith(f"part/{shard}/")]:
            del self._parts[name]
            self._set(name, None)

    def _note(self, changes: Changes) -> Iterable[dict[str, object]]:
        for (rule_id, key), state in changes.states.items():
            self._set(f"state/{rule_id}/{key}", None if state is None else json.dumps(state))
        for _, uid, row in changes.pending_added:
            self._set(f"row/{uid}", json.dumps(row))
        for _, uid in changes.pending_removed:
            self._set(f"row/{uid}", None)
        for rule_id, each in self._engine.given_up.items():
            self._set(f"given_up/{rule_id}", json.dumps(each.as_json()))
        self._set("map", json.dumps([self._map_id, self._released_us]))
        return ({"late": late.as_json()} for late in changes.late)

    def _set(self, name: str, text: str | None) -> None:
        if text is None:
            self._names.discard(name)
        else:
            self._names.add(name)
        self._changed[name] = text
