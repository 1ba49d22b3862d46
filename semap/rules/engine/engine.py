"""The rule engine: rows in, events out, on event time; no I/O and no clock.

Rows arrive in the order of the log and wait, by map, until the watermark has passed them (`sources`); then
the rules take them in the order of event time (`flow`), each with a state for each of its keys (`rule_run`)
that a compiled program steps (`program`).

The engine promises:

- the same rows give the same events with the same ids in the same order, in whatever order they arrive within
  the lateness of their sources, wherever watermarks cut them, and wherever the engine is stored and restored;
- a row that comes later is given out as late; rules that make an event of each row by itself take it all the
  same, as it comes;
- a row that is taken back while it waits has never been; later, that it was taken back is given out as late;
- what an edit did where event time has passed is taken at once, as if it were done where the map is; since no
  source says up to when a map was edited, rules that make an event of each of its changes wait for none;
- an unforeseen error in a rule puts that rule out of force, logged by its name, and the others go on.

`changes` says what is to be stored so that `restore` gives an engine that goes on in the same way. Nothing is
undone: a worker whose commit fails restores the engine from what is stored.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from semap.model.event import Event
from semap.model.given_up import GivenUp
from semap.rules.engine.map_engine import Late, MapEngine
from semap.rules.engine.rule import Rule
from semap.rules.engine.sources import Sources
from semap.rules.needs import Needs
from semap.rules.row import Row
from semap.rules.row_json import RowJson, dump_row, load_row


@dataclass(frozen=True)
class Due:
    """Rows of a map that may be taken now, in order, and up to where its watermark has come."""

    map_id: int
    until_us: int
    rows: Sequence[Row]


@dataclass(frozen=True)
class Changes:
    """What is to be stored.

    states           by rule and key; None where nothing is to be kept
    pending_added    rows that wait: map, uid, row
    pending_removed  rows that no longer wait: map, uid
    """

    states: Mapping[tuple[int, str], object] = field(default_factory=dict)
    pending_added: Sequence[tuple[int, str, RowJson]] = ()
    pending_removed: Sequence[tuple[int, str]] = ()
    late: Sequence[Late] = ()


class Engine:
    """Mutable: the rules of all maps at work."""

    def __init__(self) -> None:
        self._maps: dict[int, MapEngine] = {}
        self._rules: dict[int, Rule] = {}
        self._gone: list[MapEngine] = []

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

    def queries(self, map_id: int) -> Mapping[int, str]:
        """The names of the continuous queries that rules of a map read, by id."""
        return self._on(map_id).plan.queries()

    def reads_object_states(self, map_id: int) -> frozenset[str]:
        """The properties of objects that rules of a map read."""
        return self._on(map_id).plan.names("object_state")

    def reads_map(self, map_id: int) -> bool:
        """Whether rules of a map read its changes."""
        return bool(self._on(map_id).plan.names("map"))

    def needs(self, map_id: int) -> Needs:
        """What rows that are due need before they are taken."""
        return self._on(map_id).plan.needs()

    def released_us(self, map_id: int) -> int:
        """Up to which stamp the rows of a map have been taken."""
        return self._on(map_id).sources.released_us

    @property
    def given_up(self) -> Mapping[int, GivenUp]:
        """By rule, what its version gave up because too much was under way in a key."""
        return {rule_id: each for on_map in self._maps.values() for rule_id, each in on_map.given_up.items()}

    def arrive(self, map_id: int, row: Row) -> list[Event]:
        """Take a row off the log; gives the events that it makes although it is too late, or of the map."""
        on_map = self._maps.get(map_id)
        if on_map is None:
            return []
        events = on_map.arrive(row)
        if on_map.failed:
            self._forget_failed(on_map)
        return events

    def retract(self, map_id: int, uid: str, row: Row) -> None:
        """A row that has come was none. It is taken out where it waits; where rules took it, this is late.

        uid  of that row
        row  says so, with an identity of its own
        """
        on_map = self._maps.get(map_id)
        if on_map is not None:
            on_map.retract(uid, row)

    def watermark(self, map_id: int, source_id: int, complete_us: int, is_awaited: bool = True) -> None:
        """All rows of a source up to here have come; where it is not awaited, no more are to be expected."""
        self._on(map_id).sources.watermark(source_id, complete_us, is_awaited)

    def forget_source(self, source_id: int) -> None:
        """A source is gone, and nothing is to be expected of it."""
        for on_map in self._maps.values():
            on_map.sources.leave_out(source_id)

    def due(self) -> list[Due]:
        """What may be taken now; to be given to `take` before any row arrives."""
        found = ((map_id, on_map.due()) for map_id, on_map in self._maps.items())
        return [Due(map_id, *due) for map_id, due in found if due is not None]

    def take(self, dues: Iterable[Due]) -> list[Event]:
        """Take the rows that were due, with what was looked up for them, and what time brings with them."""
        events: list[Event] = []
        for due in dues:
            on_map = self._maps[due.map_id]
            events += on_map.take(due.rows, due.until_us)
            self._forget_failed(on_map)
        return events

    def release(self) -> list[Event]:
        """Take what is due as it is."""
        return self.take(self.due())

    def begin(self, rule_id: int, rows: Iterable[Row]) -> list[Event]:
        """Let a rule begin anew with rows of the past, or those that began what holds now, in any order.

        Rows at or before what its map has released are taken by this rule alone, and their events given.
        Later ones wait with those that wait already; a row that does so is not doubled.
        """
        rule = self._rules[rule_id]
        if not rule.enabled:
            return []
        on_map = self._on(rule.map_id)
        events = on_map.begin(rule_id, rows)
        self._forget_failed(on_map)
        return events

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

    def rules_json(self) -> dict[str, object]:
        return {str(rule_id): rule.as_json() for rule_id, rule in self._rules.items()}

    def watermarks_json(self) -> dict[str, object]:
        return {str(map_id): on_map.sources.as_json() for map_id, on_map in self._maps.items()}

    @staticmethod
    def restore(
        rules: Iterable[Rule],
        watermarks: Mapping[str, Mapping[str, object]],
        states: Iterable[tuple[int, str, object]],
        pending: Iterable[tuple[int, object]],
        given_up: Mapping[int, GivenUp] = MappingProxyType({}),
    ) -> Engine:
        """The engine of which this was stored: rules, watermarks, (rule, key, state), (map, row)."""
        engine = Engine()
        for rule in rules:
            engine.change_rule(rule.rule_id, rule)
        for map_id, document in watermarks.items():
            engine._on(int(map_id)).sources = Sources.from_json(document)
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
        on_map.failed.clear()

    def _on(self, map_id: int) -> MapEngine:
        if map_id not in self._maps:
            self._maps[map_id] = MapEngine(map_id)
        return self._maps[map_id]
