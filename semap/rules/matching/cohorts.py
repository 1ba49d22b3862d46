"""Many attempts under way in a key, each of which is told from others only by what it has bound.

Where conditions ask the row alone and the one window is that of the match, attempts whose runs stand at the
same outlooks do the same at every row. They are a **cohort**: one of them is taken on as an example, and of
the others it is kept how they were when they joined. The rows that changed any since are logged, and an
attempt is taken over those when somebody asks what it has bound: when it ends, or may skip others. So a row
costs as much for one attempt as for thousands, and each attempt is worked out once, at its end.

Attempts end and are skipped as `succession` says, in the order of their first rows.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from heapq import merge
from itertools import islice

from semap.rules.matching.attempt import Attempt, Ending, Run, is_over
from semap.rules.matching.automaton import Outlook
from semap.rules.matching.runner import Runner
from semap.rules.matching.succession import Succession
from semap.rules.row import Row


@dataclass(slots=True, eq=False)
class Log:
    """The rows that changed attempts, as far back as windows reach; the first has the number `first`."""

    runner: Runner
    rows: deque[Row] = field(default_factory=deque)
    first: int = 0

    @property
    def end(self) -> int:
        return self.first + len(self.rows)

    def over(self, attempt: Attempt, seen: int) -> Attempt:
        """The attempt after the rows from number `seen` on."""
        unseen = [*islice(reversed(self.rows), self.end - max(seen, self.first))]
        for row in reversed(unseen):
            attempt = self.runner.move(attempt, row, {}, [])
        return attempt


@dataclass(slots=True, eq=False)
class Member:
    """An attempt, worked out when its runs are asked for; until then, as it was before row `seen`."""

    attempt: Attempt
    seen: int
    log: Log

    timed_out: None = field(init=False, default=None)

    @property
    def first(self) -> Row:
        return self.attempt.first

    @property
    def runs(self) -> tuple[Run, ...]:
        return self.now().runs

    def now(self) -> Attempt:
        self.attempt, self.seen = self.as_it_is(), self.log.end
        return self.attempt

    def as_it_is(self) -> Attempt:
        """The attempt now, which is not remembered."""
        return self.log.over(self.attempt, self.seen) if self.seen < self.log.end else self.attempt


@dataclass(slots=True, eq=False)
class Cohort:
    """Attempts at the same outlooks, ascending by their first rows.

    example  stands where they do; the window of its own attempt may have ended
    may_end  whether something is found when windows end
    """

    example: Attempt
    members: deque[Member]
    outlooks: tuple[Outlook, ...] = ()
    may_end: bool = False

    def __post_init__(self) -> None:
        self.outlooks = tuple([run.outlook for run in self.example.runs])
        for outlook in self.outlooks:
            if outlook.may_finish:
                self.may_end = True


@dataclass(slots=True, eq=False)
class CohortState:
    """What is under way in one key. One that was stepped is spent.

    is_silent    whether nothing is found when windows end
    deadline_us  when time changes something first; where it is silent, when all windows have ended
    """

    cohorts: tuple[Cohort, ...]
    log: Log
    is_silent: bool
    deadline_us: int

    @property
    def attempts(self) -> tuple[Attempt, ...]:
        """All of them, worked out."""
        found = [member.now() for cohort in self.cohorts for member in cohort.members]
        return tuple(sorted(found, key=lambda attempt: attempt.first.order))


class Cohorts:
    """Takes attempts on. Those that end are added to `ends`, those given up to `given_up`."""

    def __init__(self, runner: Runner, succession: Succession, match_us: int, *, to_next: bool) -> None:
        self._runner = runner
        self._succession = succession
        self._match_us = match_us
        self._to_next = to_next

    def of(self, attempts: Iterable[Attempt]) -> CohortState | None:
        """The state of these attempts."""
        log = Log(self._runner)
        new: dict[tuple[Outlook, ...], Cohort] = {}
        for attempt in attempts:
            _put(new, Cohort(attempt, deque([Member(attempt, 0, log)])))
        return self.resumed(list(new.values()), log)

    def resumed(self, cohorts: Sequence[Cohort], log: Log) -> CohortState | None:
        """The state of these cohorts; None where they have no members."""
        left = tuple(cohort for cohort in cohorts if cohort.members)
        if not left:
            return None
        is_silent = not any(cohort.may_end for cohort in left)
        if is_silent:
            edge_us = max(cohort.members[-1].first.stamp_us for cohort in left)
        else:
            edge_us = min(cohort.members[0].first.stamp_us for cohort in left)
        return CohortState(left, log, is_silent, edge_us + self._match_us)

    def step(
        self, state: CohortState, row: Row, ends: list[Ending], given_up: list[Row], most_runs: int
    ) -> CohortState | None:
        """The state after a row; the same where it changes nothing."""
        new: dict[tuple[Outlook, ...], Cohort] = {}
        is_changed = self._expire(state, row.stamp_us, new, ends)
        log, answered = state.log, dict[Outlook, int]()
        is_moved = False
        for cohort in state.cohorts:
            if not cohort.members:
                continue
            self._keep_alive(cohort, row.stamp_us)
            moved = self._runner.move(cohort.example, row, answered, ends)
            if moved is cohort.example:
                _put(new, cohort)
                continue
            is_moved = True
            if moved.runs:
                _put(new, Cohort(moved, cohort.members))
        if is_moved:
            log.rows.append(row)
        begun = self._runner.begin(row, answered, ends)
        if begun is not None:
            _put(new, Cohort(begun, deque([Member(begun, log.end, log)])))
        if not (is_changed or is_moved or begun is not None):
            return state
        cohorts = list(new.values())
        self._settle(cohorts, ends)
        given_up += _drop_excess(cohorts, most_runs)
        self._trim(log, row.stamp_us)
        return self.resumed(cohorts, log)

    def advance(self, state: CohortState, now_us: int, ends: list[Ending]) -> CohortState | None:
        """The state when no row comes any more with a stamp before now."""
        new: dict[tuple[Outlook, ...], Cohort] = {}
        self._expire(state, now_us, new, ends)
        for cohort in state.cohorts:
            if cohort.members:
                _put(new, cohort)
        cohorts = list(new.values())
        self._settle(cohorts, ends)
        self._trim(state.log, now_us)
        return self.resumed(cohorts, state.log)

    def _expire(
        self,
        state: CohortState,
        now_us: int,
        new: dict[tuple[Outlook, ...], Cohort],
        ends: list[Ending],
    ) -> bool:
        """Take out the attempts whose windows have ended, and put those that end with a match into `new`."""
        is_changed = False
        for cohort in state.cohorts:
            members = cohort.members
            if is_over(cohort.example):
                continue
            may_end = cohort.may_end
            while members and now_us - members[0].first.stamp_us >= self._match_us:
                member = members.popleft()
                if may_end:
                    expired = self._runner.expire(member.now(), now_us, ends)
                    is_changed = True
                    if expired.runs:
                        _put(new, Cohort(expired, deque([Member(expired, state.log.end, state.log)])))
            is_changed = is_changed or not members
        # an attempt that was in the way of others may be gone
        return is_changed or any(is_over(cohort.example) for cohort in state.cohorts)

    def _keep_alive(self, cohort: Cohort, now_us: int) -> None:
        """Take another example where the window of this one has ended: it would bind rows for ever."""
        example = cohort.example
        if now_us - example.first.stamp_us >= self._match_us and not is_over(example):
            cohort.example = cohort.members[-1].as_it_is()

    def _settle(self, cohorts: list[Cohort], ends: list[Ending]) -> None:
        """Let those end of which it is certain what becomes of them."""
        over = [cohort for cohort in cohorts if is_over(cohort.example)]
        if self._to_next:
            for cohort in over:
                for member in cohort.members:
                    self._succession.end(member.now(), ends)
                cohort.members.clear()
        elif over:
            taken = [0] * len(cohorts)
            left = set(map(id, self._succession.in_turn(_in_turn(cohorts, taken), ends)))
            for cohort, count in zip(cohorts, taken, strict=True):
                looked_at = [cohort.members.popleft() for _ in range(count)]
                cohort.members.extendleft(each for each in reversed(looked_at) if id(each) in left)

    def _trim(self, log: Log, now_us: int) -> None:
        rows, match_us = log.rows, self._match_us
        while rows and now_us - rows[0].stamp_us >= match_us:
            rows.popleft()
            log.first += 1


def _in_turn(cohorts: Sequence[Cohort], taken: list[int]) -> Iterator[Member]:
    """All members by their first rows; `taken` says how many of each cohort were given."""
    streams = [_placed(cohort.members, place) for place, cohort in enumerate(cohorts)]
    for _, place, member in merge(*streams):
        taken[place] += 1
        yield member


def _placed(members: Iterable[Member], place: int) -> Iterator[tuple[tuple[int, int, str], int, Member]]:
    for member in members:
        yield member.first.order, place, member


def _put(new: dict[tuple[Outlook, ...], Cohort], cohort: Cohort) -> None:
    """Add a cohort to that at the same outlooks."""
    outlooks = cohort.outlooks
    known = new.get(outlooks)
    if known is None:
        new[outlooks] = cohort
        return
    if known.example.first.stamp_us > cohort.example.first.stamp_us:
        cohort.example = known.example
    cohort.members = _merged(known.members, cohort.members)
    new[outlooks] = cohort


def _merged(one: deque[Member], other: deque[Member]) -> deque[Member]:
    if one[0].first.order > other[0].first.order:
        one, other = other, one
    if one[-1].first.order > other[0].first.order:
        return deque(merge(one, other, key=lambda member: member.first.order))
    if len(one) < len(other):
        other.extendleft(reversed(one))
        return other
    one.extend(other)
    return one


def _drop_excess(cohorts: Sequence[Cohort], most_runs: int) -> list[Row]:
    """Give up the oldest attempts while there are more runs than that; returns their first rows."""
    given_up = []
    excess = sum(len(cohort.example.runs) * len(cohort.members) for cohort in cohorts) - most_runs
    while excess > 0:
        oldest = min(
            (cohort for cohort in cohorts if cohort.members), key=lambda cohort: cohort.members[0].first.order
        )
        excess -= len(oldest.example.runs)
        given_up.append(oldest.members.popleft().first)
    return given_up
