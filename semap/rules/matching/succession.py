"""Which attempts count: after a match, the next one may begin only where `after_match` says.

Attempts run side by side and are settled in the order of their first rows. One that has its match, or has
timed out, waits while an earlier one could still match and skip it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from semap.rules.bound import Bound
from semap.rules.declaration import AfterMatch
from semap.rules.matching.attempt import Attempt, Ending, Run, is_over
from semap.rules.matching.automaton import Finish
from semap.rules.matching.runner import Runner

Reach: TypeAlias = tuple[tuple[int, int, str], bool]
"""Attempts that begin before a row are skipped; True: that row itself too."""

NOTHING: Reach = ((-(2**63), 0, ""), False)
EVERYTHING: Reach = ((2**63, 0, ""), True)


class Succession:
    """Settles attempts."""

    def __init__(self, after_match: AfterMatch, runner: Runner) -> None:
        self._after = after_match
        self._runner = runner

    def settle(self, attempts: Sequence[Attempt], ends: list[Ending]) -> list[Attempt]:
        """The attempts that are left; matches and time-outs that are certain now are added to `ends`."""
        if len(attempts) == 1 and is_over(attempts[0]):
            self._end(attempts[0], ends)
            return []
        if self._after.skip == "to next":
            for attempt in filter(is_over, attempts):
                self._end(attempt, ends)
            return [attempt for attempt in attempts if not is_over(attempt)]
        left: list[Attempt] = []
        skipped = could_skip = NOTHING
        for place, attempt in enumerate(attempts):
            order = attempt.first.order
            if _reaches(skipped, order):
                continue
            if could_skip == EVERYTHING:
                # all that follow began later still, and wait
                return left + [each for each in attempts[place:] if each.runs or each.timed_out is not None]
            if _reaches(could_skip, order) or not is_over(attempt):
                if not attempt.runs and attempt.timed_out is None:
                    continue  # it has nothing to wait for
                left.append(attempt)
                could_skip = max(could_skip, self._could_skip(attempt))
            else:
                self._end(attempt, ends)
                if attempt.runs:
                    skipped = max(skipped, self._skip(attempt.runs[0].bound, attempt))
        return left

    def _end(self, attempt: Attempt, ends: list[Ending]) -> None:
        if attempt.runs:
            run = attempt.runs[0]
            ends.append(Ending(self._runner.stamp_us(attempt, run), attempt.first, run.bound))
        elif attempt.timed_out is not None:
            ends.append(Ending(attempt.timed_out.stamp_us, attempt.first, attempt.timed_out.bound, False))

    def _could_skip(self, attempt: Attempt) -> Reach:
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
            return any(each.variable == self._after.variable for each in run.bound.latest_first())
        return all(isinstance(choice, Finish) for choice in run.outlook.choices)

    def _skip(self, bound: Bound, attempt: Attempt) -> Reach:
        """What a match of these rows skips beyond its own first row."""
        match self._after.skip:
            case "past last":
                return bound.row.order, True
            case "to first" | "to last":
                rows = [each.row for each in bound.latest_first() if each.variable == self._after.variable]
                if rows:
                    row = rows[-1] if self._after.skip == "to first" else rows[0]
                    if row.order != attempt.first.order:
                        return row.order, False
        return attempt.first.order, True


def _reaches(reach: Reach, order: tuple[int, int, str]) -> bool:
    return (order, False) < reach
