"""A row pattern as a program: rows of one key in, matches out.

Every row may begin an attempt; an attempt is an ordered list of runs (as in Pike's virtual machine), taken on
by each row through the moves of the automaton. What is found is given as soon as nothing preferred to it is
possible any more, by rows or by the watermark. Memory of a key is bounded by the windows, and without one by
RUNS_AT_MOST: the oldest attempts go first, and are noted.

What a step did is remembered where the same must come of it again (`shape`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import is_not
from typing import TypeAlias

from semap.model.given_up import MOST_UNDER_WAY
from semap.rules.bound import Bound, Condition
from semap.rules.declaration import AfterMatch, Windows
from semap.rules.finish import Finish
from semap.rules.matching.attempt import Attempt, Ending, ends_with, is_over, path
from semap.rules.matching.automaton import FOREVER_US, Automaton, Outlook
from semap.rules.matching.runner import Runner
from semap.rules.matching.shape import UNKNOWN, Brief, Shapes, chain, turn_of
from semap.rules.matching.state_json import dump_state, load_state
from semap.rules.matching.succession import Succession
from semap.rules.pattern import Node
from semap.rules.program import Match
from semap.rules.row import Row

RUNS_AT_MOST = MOST_UNDER_WAY
FEW = 16
PRUNED_AFTER = 4
"""Windows after which a key is looked at again only to forget what has ended."""


@dataclass(slots=True)
class PatternState:
    """What is under way in one key.

    before       the last row, where a condition reads it
    deadline_us  when time alone changes something
    run_count    of all attempts
    outlooks     of all runs, once someone has asked for them
    """

    attempts: tuple[Attempt, ...]
    before: Row | None
    deadline_us: int
    run_count: int = field(default=0, compare=False)
    outlooks: frozenset[Outlook] | None = field(default=None, compare=False)


State: TypeAlias = PatternState | Brief


class PatternProgram:
    """Implements `Program`. Frozen but for what it remembers of what it has worked out already.

    given_up  the first rows of attempts that were given up because there were too many runs; to be cleared
    """

    def __init__(
        self,
        automaton: Automaton,
        after_match: AfterMatch,
        match_type: str | None,
        timeout_type: str | None,
        finish: Finish,
    ) -> None:
        keep_all = after_match.skip == "none"
        self.automaton = automaton
        self.given_up: list[Row] = []
        self.runner = Runner(automaton, keep_all=keep_all, times_out=timeout_type is not None)
        self._succession = Succession(AfterMatch("to next") if keep_all else after_match, self.runner)
        self._past_last = after_match.skip == "past last"
        by_rows_alone = not (automaton.counts_from_last or automaton.reads_bindings or automaton.waits)
        # where a run that began earlier decides all that a later one at the same outlook could
        self._earlier_decides = (
            self._past_last and timeout_type is None and by_rows_alone and automaton.match_us >= FOREVER_US
        )
        self._shapes: Shapes | None = None
        if by_rows_alone and not automaton.reads_before and after_match.skip in ("past last", "to next"):
            self._shapes = Shapes(automaton, times_out=timeout_type is not None)
        self._nothing = self._shapes.none if self._shapes is not None else None
        self._pruned_us = PRUNED_AFTER * automaton.match_us
        self._match_us = automaton.match_us
        self._types = {True: match_type, False: timeout_type}
        self._finish = finish
        self._reads_before = automaton.reads_before

    @staticmethod
    def compile(
        node: Node,
        conditions: Mapping[str, Condition],
        windows: Windows,
        after_match: AfterMatch,
        match_type: str | None,
        timeout_type: str | None,
        finish: Finish,
    ) -> PatternProgram:
        """The program of a pattern.

        conditions  by variable; a variable without one binds any row
        finish      measures and confidence of a match; None drops it; what comes after is as after a match
        raises      InvalidInput for a pattern that can match nothing, begins with an absence or ends in one
                    without a window, or that `follow.positions` refuses
        """
        automaton = Automaton(node, conditions, windows, keep_all=after_match.skip == "none")
        return PatternProgram(automaton, after_match, match_type, timeout_type, finish)

    def step(self, state: State | None, row: Row) -> tuple[State | None, tuple[Match, ...]]:
        brief = self._nothing if state is None else state
        if not isinstance(brief, Brief):
            return self._in_general(state, row)
        if row.stamp_us >= brief.deadline_us:
            if not brief.shape.is_silent or row.stamp_us < brief.over_us or self._nothing is None:
                return self._in_general(state, row)
            state, brief = None, self._nothing
        shape = brief.shape
        turn = shape.turns.get(shape.answers(row), UNKNOWN)
        if turn is None:
            return state, ()
        if turn is UNKNOWN:
            return self._learn(brief, state, row)
        if turn.end is None:
            return turn.after(brief, row), ()
        return turn.after(brief, row), self._matched(chain(turn.end, brief, row))

    def _learn(self, brief: Brief, state: State | None, row: Row) -> tuple[State | None, tuple[Match, ...]]:
        """Take a step of which nothing is remembered yet."""
        known = len(self.given_up)
        after, ends = self._step(state, row)
        if len(self.given_up) > known:
            pass  # which attempts are given up depends on more than the shape
        elif after is state and not ends:
            brief.shape.remember(row, None)
        elif after is None or isinstance(after, Brief):
            turn = turn_of(brief, row, after, ends)
            if turn is not None:
                brief.shape.remember(row, turn)
        return after, self._matches(ends) if ends else ()

    def _in_general(self, state: State | None, row: Row) -> tuple[State | None, tuple[Match, ...]]:
        """Take a step of a kind that is not remembered."""
        after, ends = self._step(state, row)
        return after, self._matches(ends) if ends else ()

    def _step(self, state: State | None, row: Row) -> tuple[State | None, list[Ending]]:
        """A step in the general way, which says what a step is."""
        ends: list[Ending] = []
        answered: dict[Outlook, int] = {}
        if state is None:
            begun = self.runner.begin(row, None, answered, ends)
            if begun is None and not ends and not self._reads_before:
                return None, ends
            return self._settled([] if begun is None else [begun], row, ends), ends
        attempts, before = state.attempts, state.before
        changed = row.stamp_us >= state.deadline_us
        if changed:
            attempts = tuple(self._expired(attempts, row.stamp_us, ends))
        if before is not None and row.stamp_us - before.stamp_us >= self._match_us:
            before = None
        if not changed and len(attempts) > FEW and isinstance(state, PatternState) and not self._reads_before:
            if state.outlooks is None:
                state.outlooks = frozenset(run.outlook for attempt in attempts for run in attempt.runs)
            if all(self.runner.passes(outlook, row, answered) for outlook in state.outlooks):
                return self._passed(state, row, answered, ends), ends
        move = self.runner.move
        moved = [move(attempt, row, before, answered, ends) for attempt in attempts]
        if not (self._past_last and moved and ends_with(moved[0], row)):
            begun = self.runner.begin(row, before, answered, ends)
            if begun is not None and self._earlier_decides and moved:
                begun = self._undecided(begun, moved[0])
            if begun is not None:
                moved.append(begun)
        changed = changed or len(moved) > len(attempts) or any(map(is_not, moved, attempts))
        if changed or ends or self._reads_before:
            return self._settled(moved, row, ends), ends
        return state, ends

    def advance(self, state: State | None, watermark_us: int) -> tuple[State | None, tuple[Match, ...]]:
        """A watermark of `automaton.FOREVER_US` says that no row will come, which ends everything."""
        now_us = watermark_us + 1 if watermark_us < FOREVER_US else 2 * FOREVER_US
        if state is None or now_us < state.deadline_us:
            return state, ()
        ends: list[Ending] = []
        expired = self._expired(state.attempts, now_us, ends)
        before = state.before
        if before is not None and now_us >= self._forgotten_us(before):
            before = None
        after = self._settled(expired, before, ends)
        return after, self._matches(ends) if ends else ()

    def deadline_us(self, state: State | None) -> int | None:
        """Where time gives nothing but only makes less, later than need be: most states end before that."""
        if state is None or state.deadline_us >= FOREVER_US:
            return None
        if isinstance(state, Brief) and state.shape.is_silent:
            return state.deadline_us - state.deadline_us % -self._pruned_us - 1
        return state.deadline_us - 1

    def dump(self, state: State) -> object:
        return dump_state(state.attempts, state.before)

    def load(self, document: object) -> State:
        state = self._state(*load_state(document, self.automaton, self.runner))
        assert state is not None  # noqa: S101
        return state

    def _passed(
        self, state: PatternState, row: Row, answered: dict[Outlook, int], ends: list[Ending]
    ) -> State | None:
        """The state after a row that interests none of the many attempts: at most, one begins."""
        begun = self.runner.begin(row, None, answered, ends)
        if begun is not None and self._earlier_decides:
            begun = self._undecided(begun, state.attempts[0])
        if begun is None:
            return state
        run_count = state.run_count + len(begun.runs)
        if is_over(begun) or run_count > RUNS_AT_MOST:
            return self._settled([*state.attempts, begun], None, ends)
        outlooks = state.outlooks and state.outlooks.union(run.outlook for run in begun.runs)
        deadline_us = min(state.deadline_us, begun.deadline_us)
        attempts = (*state.attempts, begun)
        return PatternState(attempts, None, deadline_us, run_count, outlooks)

    def _expired(self, attempts: Iterable[Attempt], now_us: int, ends: list[Ending]) -> list[Attempt]:
        expire = self.runner.expire
        return [
            attempt if now_us < attempt.deadline_us else expire(attempt, now_us, ends) for attempt in attempts
        ]

    @staticmethod
    def _undecided(begun: Attempt, earliest: Attempt) -> Attempt | None:
        """Without the runs that the earliest attempt has too: if they match, so does it, and skips them."""
        decided = {run.outlook for run in earliest.runs if run.outlook.final is None}
        runs = tuple(run for run in begun.runs if run.outlook not in decided)
        return replace(begun, runs=runs) if runs else None

    def _settled(self, attempts: list[Attempt], before: Row | None, ends: list[Ending]) -> State | None:
        """The next state; what is certain now is added to `ends`.

        before  the row before the next one, if conditions read it
        """
        for attempt in attempts:
            if is_over(attempt):
                attempts = self._succession.settle(attempts, ends)
                break
        if not self._reads_before:
            before = None
        self.given_up += drop_excess(attempts)
        return self._state(attempts, before)

    def _state(self, attempts: Sequence[Attempt], before: Row | None) -> State | None:
        if attempts and self._shapes is not None:
            brief = self._shapes.brief(attempts)
            if brief is not None:
                return brief
        if len(attempts) == 1:
            deadline_us = attempts[0].deadline_us
        elif attempts:
            deadline_us = min(attempt.deadline_us for attempt in attempts)
        elif before is not None:
            deadline_us = self._forgotten_us(before)
        else:
            return None
        run_count = sum([len(attempt.runs) for attempt in attempts])
        return PatternState(tuple(attempts), before, deadline_us, run_count)

    def _forgotten_us(self, before: Row) -> int:
        """When the row before is no longer within the match window."""
        return before.stamp_us + self._match_us

    def _matched(self, bound: Bound) -> tuple[Match, ...]:
        """The match of these rows, the last of which says when it was."""
        event_type, stamp_us = self._types[True], bound.row.stamp_us
        if event_type is None or (said := self._finish(bound, stamp_us)) is None:
            return ()
        return (Match(event_type, stamp_us, path(bound), *said),)

    def _matches(self, ends: list[Ending]) -> tuple[Match, ...]:
        if len(ends) > 1:
            ends.sort(key=lambda end: (end.stamp_us, end.first.order))
        matches = []
        for end in ends:
            event_type = self._types[end.is_match]
            if event_type is not None and (said := self._finish(end.bound, end.stamp_us)) is not None:
                matches.append(Match(event_type, end.stamp_us, path(end.bound), *said))
        return tuple(matches)


def drop_excess(attempts: list[Attempt]) -> list[Row]:
    """Give up the oldest attempts while there are more than RUNS_AT_MOST runs; returns their first rows."""
    given_up = []
    excess = sum([len(attempt.runs) for attempt in attempts]) - RUNS_AT_MOST
    while excess > 0:
        oldest = attempts.pop(0)
        excess -= len(oldest.runs)
        given_up.append(oldest.first)
    return given_up
