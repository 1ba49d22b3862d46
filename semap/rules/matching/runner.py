"""How a row, or time alone, takes an attempt on: each of its runs makes the move that the automaton says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from semap.rules.bound import NO_VARIABLE, Bound
from semap.rules.matching.attempt import Attempt, Ending, Run, TimedOut, Underway, length
from semap.rules.matching.automaton import FOREVER_US, Automaton, Finish, Move, Outcome, Outlook
from semap.rules.row import Row


class Runner:
    """Takes attempts on. Where all matches are wanted, they are added to `ends`."""

    def __init__(self, automaton: Automaton, *, keep_all: bool, times_out: bool) -> None:
        self._automaton = automaton
        self._match_us = automaton.match_us
        self._times_out = times_out
        self._asked = None if keep_all else automaton.asked if automaton.reads_bindings else ()
        self._by_last = automaton.counts_from_last

    def begin(self, row: Row, answered: dict[Outlook, int], ends: list[Ending]) -> Attempt | None:
        """The attempt that begins with this row; None if no run does.

        answered  what the conditions that ask the row alone said of it, by outlook; filled here
        """
        move = self._move(self._automaton.start, None, row, answered)
        if self._automaton.may_be_empty:
            return self._begun_or_empty(move, row, ends)
        if not move:
            return None
        if len(move) == 1:
            ((variable, after, finishes),) = move
            if variable is not None and after is not None and not finishes:
                return self._only(row, after, Bound(variable, row))
        growth = _Growth(row, self._automaton)
        growth.take(move, None, row, None)
        return self._grown(growth, ends) if growth.runs or growth.ended else None

    def _begun_or_empty(self, move: Move | None, row: Row, ends: list[Ending]) -> Attempt | None:
        """The attempt of a pattern that may bind no row, which is then a run that has ended here."""
        growth = _Growth(row, self._automaton)
        nothing = Bound(NO_VARIABLE, row)
        growth.take((Outcome(None, self._automaton.start),) if move is None else move, None, row, nothing)
        return self._grown(growth, ends) if growth.runs or growth.ended else None

    def move(self, attempt: Attempt, row: Row, answered: dict[Outlook, int], ends: list[Ending]) -> Attempt:
        """The attempt after a row; the same object if the row changes nothing."""
        if len(attempt.runs) == 1:
            (run,) = attempt.runs
            move = self._move(run.outlook, run.bound, row, answered)
            if move is None:
                return attempt
            if len(move) == 1:
                ((variable, after, finishes),) = move
                if variable is not None and after is not None and not finishes:
                    return self._only(attempt.first, after, Bound(variable, row, run.bound), attempt.found)
            moves: list[Move | None] = [move]
        else:
            moves = [self._move(run.outlook, run.bound, row, answered) for run in attempt.runs]
            if not any(move is not None for move in moves):
                return attempt
        growth = _Growth(attempt.first, self._automaton)
        for run, move in zip(attempt.runs, moves, strict=True):
            if move is None:
                growth.runs.append(run)
            else:
                growth.take(move, run.bound, row, run.bound)
        return self._grown(growth, ends, attempt.found)

    def passes(self, outlook: Outlook, row: Row, answered: dict[Outlook, int]) -> bool:
        """Whether the row changes no run at this outlook, whatever it has bound."""
        return not outlook.questions and self._move(outlook, None, row, answered) is None

    def expire(self, attempt: Attempt, now_us: int, ends: list[Ending]) -> Attempt:
        """The attempt when no row comes any more with a stamp before now."""
        if now_us < attempt.deadline_us or not attempt.runs:
            return attempt
        growth = _Growth(attempt.first, self._automaton)
        over = []
        for run in attempt.runs:
            if now_us < run.deadline_us:
                growth.runs.append(run)
                continue
            expired = self._automaton.expired(run.outlook, run.bound, attempt.first.stamp_us, now_us)
            growth.add(expired.outlook, run.bound, expired.ends)
            if expired.outlook is None and not expired.ends:
                over.append(run)
        left = self._grown(growth, ends, attempt.found)
        if self._times_out and not left.runs and not left.found:
            return replace(left, timed_out=self._timed_out(attempt.first, over))
        return left

    def stamp_us(self, attempt: Underway, run: Run) -> int:
        """The stamp of the match that a run is which has ended."""
        final, last_us = run.outlook.final, run.bound.row.stamp_us
        return last_us if final is None else self._automaton.stamp_us(final, attempt.first.stamp_us, last_us)

    def resume(self, first: Row, runs: Iterable[tuple[Outlook, Bound]], *, found: bool) -> Attempt:
        """The attempt with these runs."""
        growth = _Growth(first, self._automaton)
        for outlook, bound in runs:
            growth.add(outlook, bound, ())
        return self._grown(growth, [], found)

    def _move(
        self,
        outlook: Outlook,
        bound: Bound | None,
        row: Row,
        answered: dict[Outlook, int],
    ) -> Move | None:
        answers = answered.get(outlook)
        if answers is None:
            answers = 0
            for bit, test in outlook.simple:
                if test(row):
                    answers |= bit
            answered[outlook] = answers
        for bit, variable, condition, within_us in outlook.questions:
            if bound is not None and row.stamp_us - bound.row.stamp_us >= within_us:
                continue
            if condition.test is not None:
                holds = condition.test(row)
            else:
                holds = condition.test_bound(row, Bound(variable, row, bound))
            if holds:
                answers |= bit
        moves = outlook.moves
        return moves[answers] if answers in moves else self._automaton.move(outlook, answers)

    def _only(self, first: Row, outlook: Outlook, bound: Bound, found: bool = False) -> Attempt:
        """The attempt with one run."""
        if outlook.from_first:
            deadline_us = first.stamp_us + self._match_us
        elif outlook.final is not None:
            deadline_us = FOREVER_US
        else:
            deadline_us = self._automaton.deadline_us(outlook, first.stamp_us, bound.row.stamp_us)
        return Attempt(first, (Run(outlook, bound, deadline_us),), deadline_us, found)

    def _grown(self, growth: _Growth, ends: list[Ending], found: bool = False) -> Attempt:
        ends.extend(growth.ended.values())
        runs = self._merged(growth.runs) if len(growth.runs) > 1 else tuple(growth.runs)
        deadline_us = min((run.deadline_us for run in runs), default=FOREVER_US)
        return Attempt(growth.first, runs, deadline_us, found or bool(growth.ended))

    def _merged(self, runs: list[Run]) -> tuple[Run, ...]:
        """The most preferred of those runs that have the same future; none after one that has ended."""
        kept: dict[tuple[object, ...], Run] = {}
        for run in runs:
            outlook, bound = run.outlook, run.bound
            key: tuple[object, ...] = (
                outlook,
                id(bound) if self._asked is None else tuple([asked.rows(bound) for asked in self._asked]),
                bound.row.stamp_us if self._by_last else None,
                length(bound) if self._times_out else None,
            )
            kept.setdefault(key, run)
            if outlook.final is not None:
                break
        return tuple(kept.values())

    def _timed_out(self, first: Row, over: list[Run]) -> TimedOut | None:
        """The partial match of runs that windows have ended, the preferred run first."""
        best: tuple[int, int] | None = None
        partial: TimedOut | None = None
        for run in over:
            outlook, bound = run.outlook, run.bound
            last_us = bound.row.stamp_us
            end_us = max(
                self._automaton.end_us(choice, first.stamp_us, last_us) for choice in outlook.choices
            )
            rank = end_us, length(bound)
            if best is None or rank > best:
                best, partial = rank, TimedOut(bound, end_us)
        return partial if partial is not None and partial.stamp_us < FOREVER_US else None


class _Growth:
    """The runs of an attempt as they come, the preferred first, and how it has ended."""

    def __init__(self, first: Row, automaton: Automaton) -> None:
        self.first = first
        self.runs: list[Run] = []
        self.ended: dict[tuple[int, int], Ending] = {}
        self._automaton = automaton
        self._chains: dict[tuple[int, str], Bound] = {}

    def take(self, move: Move, held: Bound | None, row: Row, passed: Bound | None) -> None:
        """What a row makes of the run that holds these rows; `passed`: what it holds without it."""
        for variable, after, ends in move:
            if variable is not None:
                self.add(after, self._bound(variable, row, held), ends)
            elif passed is not None:
                self.add(after, passed, ends)

    def add(self, outlook: Outlook | None, bound: Bound, ends: tuple[Finish, ...]) -> None:
        first_us, last_us = self.first.stamp_us, bound.row.stamp_us
        for finish in ends:
            stamp_us = self._automaton.stamp_us(finish, first_us, last_us)
            self.ended.setdefault((id(bound), stamp_us), Ending(stamp_us, self.first, bound))
        if outlook is not None:
            self.runs.append(Run(outlook, bound, self._automaton.deadline_us(outlook, first_us, last_us)))

    def _bound(self, variable: str, row: Row, held: Bound | None) -> Bound:
        """One chain for the same rows as the same variables, so that such runs are known by identity."""
        key = (id(held), variable)
        if key not in self._chains:
            self._chains[key] = Bound(variable, row, held)
        return self._chains[key]
