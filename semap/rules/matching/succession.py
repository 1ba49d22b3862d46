"""Which attempts count: after a match, the next one may begin only where `after_match` says.

Attempts run side by side and are settled in the order of their first rows. One that has its match, or has
timed out, waits while an earlier one could still match and skip it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias, TypeVar

from semap.errors import InvalidInput
from semap.rules.bound import NO_VARIABLE, Bound
from semap.rules.declaration import AfterMatch
from semap.rules.matching.attempt import Attempt, Ending, Run, Underway, is_over
from semap.rules.matching.automaton import Finish
from semap.rules.matching.runner import Runner

Reach: TypeAlias = tuple[tuple[int, int, str], bool]
"""Attempts that begin before a row are skipped; True: that row itself too."""

AnyAttempt = TypeVar("AnyAttempt", bound=Underway)

NOTHING: Reach = ((-(2**63), 0, ""), False)
EVERYTHING: Reach = ((2**63, 0, ""), True)


class Succession:
    """Settles attempts.

    in_order  whether attempts end in the order in which they began, also where none can skip another
    """

    def __init__(self, after_match: AfterMatch, runner: Runner, *, in_order: bool) -> None:
        self._after = after_match
        self._runner = runner
        self._in_order = in_order

    def settle(self, attempts: Sequence[Attempt], ends: list[Ending]) -> list[Attempt]:
        """The attempts that are left; matches and time-outs that are certain now are added to `ends`."""
        if len(attempts) == 1 and is_over(attempts[0]):
            self.end(attempts[0], ends)
            return []
        if self._after.skip == "to next":
            waiting = False
            to_wait = []
            for attempt in attempts:
                waiting = waiting or (self._in_order and not is_over(attempt))
                if is_over(attempt) and not waiting:
                    self.end(attempt, ends)
                elif attempt.runs or attempt.timed_out is not None:
                    to_wait.append(attempt)
            return to_wait
        in_order = iter(attempts)
        left = self.in_turn(in_order, ends)
        return left + [each for each in in_order if each.runs or each.timed_out is not None]

    def in_turn(self, attempts: Iterator[AnyAttempt], ends: list[Ending]) -> list[AnyAttempt]:
        """Look at attempts in order until one could skip all that follow; those of them that are left."""
        left: list[AnyAttempt] = []
        skipped = could_skip = NOTHING
        for attempt in attempts:
            order = attempt.first.order
            if _reaches(skipped, order):
                continue
            if _reaches(could_skip, order) or not is_over(attempt):
                if not attempt.runs and attempt.timed_out is None:
                    continue  # it has nothing to wait for
                left.append(attempt)
                could_skip = max(could_skip, self._could_skip(attempt))
                if could_skip == EVERYTHING:
                    break
            else:
                self.end(attempt, ends)
                if attempt.runs:
                    skipped = max(skipped, self._skip(attempt.runs[0].bound, attempt))
        return left

    def end(self, attempt: Underway, ends: list[Ending]) -> None:
        """Its match, or its time-out."""
        if attempt.runs:
            run = attempt.runs[0]
            if self._after.strict:
                self._require_target(run.bound, attempt)
            ends.append(Ending(self._runner.stamp_us(attempt, run), attempt.first, run.bound))
        elif attempt.timed_out is not None:
            ends.append(Ending(attempt.timed_out.stamp_us, attempt.first, attempt.timed_out.bound, False))

    def _could_skip(self, attempt: Underway) -> Reach:
        """How far the attempt's match could reach, whichever it will be."""
        reach = NOTHING
        for run in attempt.runs:
            if self._is_known(run):
                reach = max(reach, self._skip(run.bound, attempt))
            else:
                return EVERYTHING
        return reach

    def _is_known(self, run: Run) -> bool:
        """Whether a match that this run becomes skips as far as its rows say now."""
        if self._after.skip == "to first":
            return any(each.variable in self._after.variables for each in run.bound.latest_first())
        return all(isinstance(choice, Finish) for choice in run.outlook.choices)

    def _require_target(self, bound: Bound, attempt: Underway) -> None:
        """raises InvalidInput where the standard has an exception"""
        if bound.variable == NO_VARIABLE or self._after.skip not in ("to first", "to last"):
            return
        if self._skip(bound, attempt) == (attempt.first.order, True):
            names = " or ".join(sorted(self._after.variables))
            raise InvalidInput(
                f"after_match: a match that begins with row {attempt.first.uid} has no row bound to {names}"
                " after its first one, to which the rule could skip",
                "Leave out `or fail`, which goes on with the row after its first.",
            )

    def _skip(self, bound: Bound, attempt: Underway) -> Reach:
        """What a match of these rows skips beyond its own first row."""
        match self._after.skip:
            case "past last":
                return bound.row.order, True
            case "to first" | "to last":
                rows = [each.row for each in bound.latest_first() if each.variable in self._after.variables]
                if rows:
                    row = rows[-1] if self._after.skip == "to first" else rows[0]
                    if row.order != attempt.first.order:
                        return row.order, False
        return attempt.first.order, True


def _reaches(reach: Reach, order: tuple[int, int, str]) -> bool:
    return (order, False) < reach
