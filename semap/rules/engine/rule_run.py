"""One rule at work: a state for each of its keys, and the timers that these have set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from heapq import heappush
from itertools import count
from typing import TypeAlias

from semap.rules.compilation import compile_rule, compile_where
from semap.rules.engine.event_making import EventMaker
from semap.rules.engine.partition import Key, key_reader, key_text, read_key
from semap.rules.engine.preparation import Preparation
from semap.rules.engine.presence import is_place
from semap.rules.engine.rule import Rule
from semap.rules.program import Match, State
from semap.rules.row import Row

Found: TypeAlias = tuple[Key, Match]


class Timers:
    """When states want to be advanced, over all rules of a map: a heap by deadline."""

    def __init__(self) -> None:
        self.heap: list[tuple[int, int, RuleRun, Key]] = []
        self._number = count()

    def push(self, deadline_us: int, run: RuleRun, key: Key) -> None:
        heappush(self.heap, (deadline_us, next(self._number), run, key))


class RuleRun:
    """Mutable. `take` and `fire` give what was found, by key.

    place  among the rules of the map, those that it reads before it
    """

    def __init__(self, rule: Rule, timers: Timers) -> None:
        declaration = rule.declaration
        self.rule = rule
        self.place = 0
        self.maker = EventMaker(rule)
        self._timers = timers
        self._program = compile_rule(declaration)
        self._step = self._program.step
        self._deadline_us = self._program.deadline_us
        self._where = compile_where(declaration)
        self._key_of = key_reader(declaration.partition_by)
        self._states: dict[Key, State] = {}
        self._armed: dict[Key, int] = {}
        self._changed: set[Key] = set()
        self._preparation = Preparation(declaration)
        self._presence = self._preparation.presence
        self.take: Callable[[Row], Sequence[Found]] = (
            self._take_prepared if self._preparation.is_needed else self._take
        )

    def _take_prepared(self, row: Row) -> Sequence[Found]:
        return [found for each in self._preparation.rows(row) for found in self._take(each)]

    def _take(self, row: Row) -> Sequence[Found]:
        """Take the next row in order."""
        if self._where is not None and not self._where(row):
            return ()
        key = self._key_of(row)
        if key is None:
            return ()
        before = self._states.get(key)
        after, matches = self._step(before, row)
        if after is not before:
            self._keep(key, after)
        if not matches:
            return ()
        return ((key, matches[0]),) if len(matches) == 1 else [(key, match) for match in matches]

    def is_due(self, key: Key, timer_us: int, moment_us: int) -> bool:
        """Whether a timer that was set still counts; where the state has more time, it is set again."""
        if self._armed.get(key) != timer_us:
            return False
        state = self._states.get(key)
        deadline_us = None if state is None else self._deadline_us(state)
        if deadline_us is None:
            del self._armed[key]
            return False
        if deadline_us > moment_us:
            self._arm(key, deadline_us)
            return False
        return True

    def fire(self, key: Key, timer_us: int, moment_us: int) -> Sequence[Found]:
        """Do what a timer asks for, now that all rows up to this moment have come."""
        if not self.is_due(key, timer_us, moment_us):
            return ()
        del self._armed[key]
        after, matches = self._program.advance(self._states[key], moment_us)
        self._keep(key, after, moment_us + 1)
        return [(key, match) for match in matches]

    def _keep(self, key: Key, state: State | None, earliest_us: int | None = None) -> None:
        self._changed.add(key)
        if state is None:
            self._states.pop(key, None)
            return
        self._states[key] = state
        armed_us = self._armed.get(key)
        deadline_us = self._deadline_us(state)
        if deadline_us is None or (armed_us is not None and armed_us <= deadline_us):
            # a timer that is set too early is set again when it fires: most states end before that
            return
        if earliest_us is not None and deadline_us < earliest_us:
            deadline_us = earliest_us
        self._arm(key, deadline_us)

    def _arm(self, key: Key, deadline_us: int) -> None:
        self._armed[key] = deadline_us
        self._timers.push(deadline_us, self, key)

    def end(self) -> None:
        """Take nothing any more, and let no timer count."""
        self.take = lambda row: ()
        self._armed.clear()

    def move_to(self, timers: Timers) -> None:
        """Set all timers there."""
        self._timers = timers
        self._armed.clear()
        for key, state in self._states.items():
            deadline_us = self._deadline_us(state)
            if deadline_us is not None:
                self._arm(key, deadline_us)

    @property
    def dropped(self) -> int:
        """What was given up because too much was under way in a key, since the rule was put to work here."""
        return int(getattr(self._program, "dropped", 0))

    def changes(self) -> Iterable[tuple[str, object]]:
        """What is to be stored since the last call: texts of keys with states as JSON, None for no state."""
        changed, self._changed = self._changed, set()
        for key in changed:
            state = self._states.get(key)
            yield key_text(key), None if state is None else self._program.dump(state)
        if self._presence is not None:
            yield from self._presence.changes()

    def load(self, text: str, document: object) -> None:
        """Take what was stored under one key; `move_to` sets its timers."""
        if not is_place(text):
            self._states[read_key(text)] = self._program.load(document)
        elif self._presence is not None and isinstance(document, list):
            self._presence.load(text, document)

    def stored(self) -> Iterable[str]:
        """The keys under which something may be stored."""
        yield from map(key_text, self._states.keys() | self._changed)
        if self._presence is not None:
            yield from self._presence.texts()
