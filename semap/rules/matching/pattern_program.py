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
from typing import Any, TypeAlias, cast

from semap.model.given_up import MOST_UNDER_WAY
from semap.rules.declaration import AfterMatch
from semap.rules.matching.all_matches import PRUNED_AFTER
from semap.rules.matching.attempt import Attempt, Ending, ends_with, is_over
from semap.rules.matching.automaton import FOREVER_US, Automaton, Outlook
from semap.rules.matching.cohorts import Cohorts, CohortState
from semap.rules.matching.runner import Runner
from semap.rules.matching.shape import UNKNOWN, Brief, Shapes, chain, turn_of
from semap.rules.matching.state_json import dump_cohorts, dump_state, load_cohorts, load_state
from semap.rules.matching.succession import Succession
from semap.rules.matching.telling import Teller
from semap.rules.program import Match
from semap.rules.row import Row

ALL_MATCHES = ("none", "clear")
RUNS_AT_MOST = MOST_UNDER_WAY
FEW = 8


@dataclass(slots=True)
class PatternState:
    """What is under way in one key.

    deadline_us  when time alone changes something
    run_count    of all attempts
    outlooks     of all runs, once someone has asked for them
    """

    attempts: tuple[Attempt, ...]
    deadline_us: int
    run_count: int = field(default=0, compare=False)
    outlooks: frozenset[Outlook] | None = field(default=None, compare=False)


State: TypeAlias = PatternState | Brief | CohortState


class PatternProgram:
    """Implements `LossyProgram`. Frozen but for what it remembers of what it has worked out already.

    in_order  whether matches are told in the order in which they began
    shares    whether attempts may share what is alike in them; else each is known by itself
    """

    def __init__(
        self,
        automaton: Automaton,
        after_match: AfterMatch,
        telling: Teller,
        *,
        times_out: bool = False,
        in_order: bool = False,
        shares: bool = True,
    ) -> None:
        keep_all = after_match.skip in ALL_MATCHES
        self.automaton = automaton
        self.given_up: list[Row] = []
        self.untold: list[tuple[Row, int]] = []
        self._at_most = after_match.at_most if keep_all else None
        self.runner = Runner(automaton, keep_all=keep_all, times_out=times_out)
        self._succession = Succession(
            AfterMatch("to next") if keep_all else after_match, self.runner, in_order=in_order
        )
        self._clears = after_match.skip == "clear"
        self._past_last = after_match.skip == "past last"
        by_first_row = automaton.by_first_row
        by_rows_alone = by_first_row and not automaton.waits
        # where a run that began earlier decides all that a later one at the same outlook could
        self._earlier_decides = (
            self._past_last and not times_out and by_rows_alone and automaton.match_us >= FOREVER_US
        )
        self._shapes: Shapes | None = None
        if by_rows_alone and not in_order and after_match.skip in ("past last", "to next"):
            self._shapes = Shapes(automaton, times_out=times_out)
        self._cohorts: Cohorts | None = None
        if shares and by_first_row and not (keep_all or in_order or times_out or self._earlier_decides):
            self._cohorts = Cohorts(
                self.runner, self._succession, automaton.match_us, to_next=after_match.skip == "to next"
            )
        self._nothing = self._shapes.none if self._shapes is not None else None
        self._pruned_us = PRUNED_AFTER * automaton.match_us
        self._match_us = automaton.match_us
        self._told_of_one, self._told_of = telling.one, telling.all

    def step(self, state: State | None, row: Row) -> tuple[State | None, tuple[Match, ...]]:
        brief = self._nothing if state is None else state
        if not isinstance(brief, Brief):
            return self._in_general(state, row)
        before = state
        if row.stamp_us >= brief.deadline_us:
            left = self._shapes.left(brief, row.stamp_us) if self._shapes is not None else None
            if left is None:
                return self._in_general(state, row)
            brief, state = left, left if left.firsts else None
        shape = brief.shape
        turn = shape.turns.get(shape.answers(row), UNKNOWN)
        if turn is None:
            return before if state is not None else None, ()
        if turn is UNKNOWN:
            return self._learn(brief, state, row)
        if turn.end is None:
            return turn.after(brief, row), ()
        return turn.after(brief, row), self._told_of_one(chain(turn.end, brief, row))

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
        return after, self._tell(ends) if ends else ()

    def _in_general(self, state: State | None, row: Row) -> tuple[State | None, tuple[Match, ...]]:
        """Take a step of a kind that is not remembered."""
        after, ends = self._step(state, row)
        return after, self._tell(ends) if ends else ()

    def _step(self, state: State | None, row: Row) -> tuple[State | None, list[Ending]]:
        """A step in the general way, which says what a step is."""
        ends: list[Ending] = []
        if isinstance(state, CohortState):
            assert self._cohorts is not None  # noqa: S101
            return self._cohorts.step(state, row, ends, self.given_up, RUNS_AT_MOST), ends
        answered: dict[Outlook, int] = {}
        if state is None:
            begun = self.runner.begin(row, answered, ends)
            return None if begun is None else self._settled([begun], ends), ends
        attempts = state.attempts
        changed = row.stamp_us >= state.deadline_us
        if changed:
            attempts = tuple(self._expired(attempts, row.stamp_us, ends))
            if self._clears and any(end.is_match for end in ends):
                after, more = self._step(None, row)
                return after, ends + more
        if not changed and len(attempts) > FEW and isinstance(state, PatternState):
            if state.outlooks is None:
                state.outlooks = frozenset(run.outlook for attempt in attempts for run in attempt.runs)
            if all(self.runner.passes(outlook, row, answered) for outlook in state.outlooks):
                return self._passed(state, row, answered, ends), ends
        move = self.runner.move
        moved = [move(attempt, row, answered, ends) for attempt in attempts]
        if not (self._past_last and moved and ends_with(moved[0], row)):
            begun = self.runner.begin(row, answered, ends)
            if begun is not None and self._earlier_decides and moved:
                begun = self._undecided(begun, moved[0])
            if begun is not None:
                moved.append(begun)
        changed = changed or len(moved) > len(attempts) or any(map(is_not, moved, attempts))
        if changed or ends:
            return self._settled(moved, ends), ends
        return state, ends

    def advance(self, state: State | None, watermark_us: int) -> tuple[State | None, tuple[Match, ...]]:
        """A watermark of `automaton.FOREVER_US` says that no row will come, which ends everything."""
        now_us = watermark_us + 1 if watermark_us < FOREVER_US else 2 * FOREVER_US
        if state is None or now_us < state.deadline_us:
            return state, ()
        ends: list[Ending] = []
        after: State | None
        if isinstance(state, CohortState):
            assert self._cohorts is not None  # noqa: S101
            after = self._cohorts.advance(state, now_us, ends)
        else:
            after = self._settled(self._expired(state.attempts, now_us, ends), ends)
        return after, self._tell(ends) if ends else ()

    def _tell(self, ends: list[Ending]) -> tuple[Match, ...]:
        """What is told of endings: of the matches of one stamp no more than the rule wants."""
        if self._at_most is None or len(ends) <= self._at_most:
            return self._told_of(ends)
        told: list[Ending] = []
        counts: dict[int, int] = {}
        for end in ends:
            counts[end.stamp_us] = counts.get(end.stamp_us, 0) + end.is_match
            if not end.is_match or counts[end.stamp_us] <= self._at_most:
                told.append(end)
        if len(told) < len(ends):
            self.untold.append((min(ends, key=lambda end: end.first.order).first, len(ends) - len(told)))
        return self._told_of(told)

    def deadline_us(self, state: State | None) -> int | None:
        """Where time gives nothing but only makes less, later than need be: most states end before that."""
        if state is None or state.deadline_us >= FOREVER_US:
            return None
        is_silent = (
            state.is_silent
            if isinstance(state, CohortState)
            else (isinstance(state, Brief) and state.shape.is_silent)
        )
        if is_silent:
            return state.deadline_us - state.deadline_us % -self._pruned_us - 1
        return state.deadline_us - 1

    def dump(self, state: State) -> object:
        return dump_cohorts(state) if isinstance(state, CohortState) else dump_state(state.attempts)

    def load(self, document: object) -> State:
        stored = cast(Mapping[str, Any], document)
        state: State | None
        if "cohorts" in stored and self._cohorts is not None:
            state = self._cohorts.resumed(*load_cohorts(stored, self.automaton, self.runner))
        else:
            state = self._state(load_state(stored, self.automaton, self.runner))
        assert state is not None  # noqa: S101
        return state

    def _passed(
        self, state: PatternState, row: Row, answered: dict[Outlook, int], ends: list[Ending]
    ) -> State | None:
        """The state after a row that interests none of the many attempts: at most, one begins."""
        begun = self.runner.begin(row, answered, ends)
        if begun is not None and self._earlier_decides:
            begun = self._undecided(begun, state.attempts[0])
        if begun is None:
            return state
        run_count = state.run_count + len(begun.runs)
        if is_over(begun) or run_count > RUNS_AT_MOST:
            return self._settled([*state.attempts, begun], ends)
        outlooks = state.outlooks and state.outlooks.union(run.outlook for run in begun.runs)
        deadline_us = min(state.deadline_us, begun.deadline_us)
        attempts = (*state.attempts, begun)
        return PatternState(attempts, deadline_us, run_count, outlooks)

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

    def _settled(self, attempts: list[Attempt], ends: list[Ending]) -> State | None:
        """The next state; what is certain now is added to `ends`."""
        if self._clears and any(end.is_match for end in ends):
            return None
        for attempt in attempts:
            if is_over(attempt):
                attempts = self._succession.settle(attempts, ends)
                break
        self.given_up += drop_excess(attempts)
        return self._state(attempts)

    def _state(self, attempts: Sequence[Attempt]) -> State | None:
        if not attempts:
            return None
        if self._shapes is not None:
            brief = self._shapes.brief(attempts)
            if brief is not None:
                return brief
        if self._cohorts is not None and len(attempts) > FEW:
            return self._cohorts.of(attempts)
        if len(attempts) == 1:
            deadline_us = attempts[0].deadline_us
        else:
            deadline_us = min(attempt.deadline_us for attempt in attempts)
        run_count = sum([len(attempt.runs) for attempt in attempts])
        return PatternState(tuple(attempts), deadline_us, run_count)


def drop_excess(attempts: list[Attempt]) -> list[Row]:
    """Give up the oldest attempts while there are more than RUNS_AT_MOST runs; returns their first rows."""
    given_up = []
    excess = sum([len(attempt.runs) for attempt in attempts]) - RUNS_AT_MOST
    while excess > 0:
        oldest = attempts.pop(0)
        excess -= len(oldest.runs)
        given_up.append(oldest.first)
    return given_up
