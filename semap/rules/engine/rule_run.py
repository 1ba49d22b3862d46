"""One rule at work: a state for each of its keys, and the timers that these have set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from heapq import heappush
from itertools import count
from typing import TypeAlias

from semap.model.given_up import MOST_COUNTED, GivenUp
from semap.rules.compilation import compile_rule, compile_where
from semap.rules.engine.event_making import EventMaker
from semap.rules.engine.partition import Key, key_reader, key_text, part_of, read_key
from semap.rules.engine.preparation import Preparation
from semap.rules.engine.presence import is_place
from semap.rules.engine.rule import Rule
from semap.rules.program import Match, State
from semap.rules.row import Row
from semap.timeline.stamp import to_datetime

Found: TypeAlias = tuple[Key, Match]


NOTED_AT_ONCE = 1_000
"""Of rows at which more matches ended than are told."""


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
        self._given_up: GivenUp | None = None
        self._program = compile_rule(declaration)
        self._excess: list[Row] = getattr(self._program, "given_up", [])
        self._untold: list[tuple[Row, int]] = getattr(self._program, "untold", [])
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
        if self._excess or len(self._untold) > NOTED_AT_ONCE:
            self._note_given_up()
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
        if self._excess:
            self._note_given_up()
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

    @property
    def given_up(self) -> GivenUp | None:
        """Because too much was under way in a key, or ended there at once, since this version is in force."""
        if self._excess or self._untold:
            self._note_given_up()
        return self._given_up

    def add_given_up(self, given_up: GivenUp) -> None:
        """It has given this up as well."""
        self._given_up = given_up if self._given_up is None else self._given_up + given_up

    def _note_given_up(self) -> None:
        self.add_given_up(given_up_of(self.rule.declaration.partition_by, self._excess, self._untold))
        self._excess.clear()
        self._untold.clear()

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


def given_up_of(
    partition_by: Sequence[str], firsts: Sequence[Row], untold: Sequence[tuple[Row, int]]
) -> GivenUp:
    """What was given up in one key: attempts that began with these rows, and matches that were not told."""
    first = min((*firsts, *(row for row, _ in untold)), key=lambda row: row.order)
    key = {name: part_of(first.values, name.split(".")) for name in partition_by}
    matches = min(sum(count for _, count in untold), MOST_COUNTED)
    return GivenUp(len(firsts), to_datetime(first.own_stamp_us), key, matches)
