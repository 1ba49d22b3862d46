"""The one form of what is measured, in tables and in results.json: median, least and most of some rounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

Rows = list[dict[str, object]]
"""Of a table: what is compared as it is, what was measured as a Figure."""


@dataclass(frozen=True)
class Figure:
    """What was measured in each round, in the order of the rounds.

    digits  after the point, as it is shown
    """

    rounds: tuple[float, ...]
    digits: int = 0

    @property
    def median(self) -> float:
        return self._rounded(median(self.rounds))

    def as_json(self) -> dict[str, float]:
        return {
            "median": self.median,
            "min": self._rounded(min(self.rounds)),
            "max": self._rounded(max(self.rounds)),
            "rounds": len(self.rounds),
        }

    def __str__(self) -> str:
        if len(self.rounds) == 1:
            return f"{self.median:g}"
        said = self.as_json()
        middle, least, most = (f"{said[key]:.{self.digits}f}" for key in ("median", "min", "max"))
        return f"{middle} [{least} {most}]"

    def _rounded(self, value: float) -> float:
        """A whole number where there is nothing after the point."""
        return round(value, self.digits) if self.digits else round(value)


def figure(rounds: Iterable[float], digits: int = 0) -> Figure:
    """What was measured in some rounds."""
    return Figure(tuple(float(value) for value in rounds), digits)


def once(value: float, digits: int = 0) -> Figure:
    """What was measured in the only round of a benchmark that is repeated as a whole, or not at all."""
    return figure([value], digits)


def joined(runs: Sequence[Rows]) -> Rows:
    """Runs of one benchmark as one, whose figures have the rounds of all; all else is as in the last.

    raises  ValueError where runs have different rows
    """
    if len({len(rows) for rows in runs}) != 1:
        raise ValueError("The runs have different rows.")
    return [_joined(same) for same in zip(*runs, strict=True)]


def as_json(rows: Rows) -> Rows:
    return [
        {title: each.as_json() if isinstance(each, Figure) else each for title, each in row.items()}
        for row in rows
    ]


def percentiles(rounds: Sequence[Sequence[float]], digits: int = 2) -> dict[str, Figure]:
    """Of times [ms] in some rounds: the median, what one in a hundred exceeds, and the longest.

    Rounds without any are left out.
    """
    shares = {"p50_ms": 50, "p99_ms": 99, "max_ms": 100}
    return {
        title: figure((np.percentile(times, of) for times in rounds if len(times)), digits)
        for title, of in shares.items()
    }


def timed_ms(act: Callable[[], object]) -> float:
    """How long it takes."""
    started_s = time.perf_counter()
    act()
    return 1e3 * (time.perf_counter() - started_s)


def _joined(rows: Sequence[dict[str, object]]) -> dict[str, object]:
    whole = dict(rows[-1])
    for title, last in whole.items():
        if isinstance(last, Figure):
            measured = [each for row in rows if isinstance(each := row[title], Figure)]
            whole[title] = figure((value for each in measured for value in each.rounds), last.digits)
    return whole
