"""How sure a match is, by the gap between two of its rows: the share of gaps that are at least as long.

That share is the survival function of a distribution that is declared, or learnt from gaps by maximum
likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import erfc, exp, fsum, isfinite, log, sqrt
from typing import Literal

from semap.errors import InvalidInput
from semap.rules.bound import Bound
from semap.rules.declaration import Confidence

Distribution = Literal["lognormal", "normal", "exponential"]


def survival(confidence: Confidence, gap_s: float) -> float:
    """The share of gaps that are at least `gap_s` [s] long, 0 to 1."""
    given = confidence.parameters
    match confidence.distribution:
        case "lognormal":
            if gap_s <= 0:
                return 1.0
            return _normal_survival((log(gap_s) - log(given["median_s"])) / given["sigma"])
        case "normal":
            return _normal_survival((gap_s - given["mean_s"]) / given["std_s"])
        case "exponential":
            return exp(-max(gap_s, 0.0) / given["mean_s"])


def confidence_of(confidence: Confidence, bound: Bound) -> float | None:
    """How sure the rows bound are; None where one of the gap's variables is bound to no row."""
    gap_s = gap_of(confidence, bound)
    return None if gap_s is None else survival(confidence, gap_s)


def gap_of(confidence: Confidence, bound: Bound) -> float | None:
    """From the first row of the variable `first` to the last one of `last` [s]."""
    first_us = last_us = None
    for each in bound.latest_first():
        if each.variable == confidence.last and last_us is None:
            last_us = each.row.own_stamp_us
        if each.variable == confidence.first:
            first_us = each.row.own_stamp_us
    return None if first_us is None or last_us is None else (last_us - first_us) / 1e6


def learn(distribution: Distribution, gaps_s: Sequence[float]) -> dict[str, float]:
    """The parameters under which these gaps [s] are likeliest.

    raises InvalidInput where no parameters are: no gaps, gaps that a distribution cannot have, or all alike
    """
    if not gaps_s or not all(map(isfinite, gaps_s)):
        raise InvalidInput("there are no gaps to learn from", "Choose a period in which the rule matched.")
    if distribution == "exponential":
        mean_s, _ = _moments(gaps_s)
        if mean_s <= 0 or min(gaps_s) < 0:
            raise InvalidInput("gaps of an exponential distribution are positive", "Choose normal instead.")
        return {"mean_s": mean_s}
    if distribution == "normal":
        mean_s, std_s = _moments(gaps_s)
        return {"mean_s": mean_s, "std_s": _spread(std_s)}
    if min(gaps_s) <= 0:
        raise InvalidInput("gaps of a lognormal distribution are positive", "Choose normal instead.")
    mean, sigma = _moments([log(gap_s) for gap_s in gaps_s])
    return {"median_s": exp(mean), "sigma": _spread(sigma)}


def _normal_survival(deviations: float) -> float:
    return 0.5 * erfc(deviations / sqrt(2))


def _moments(values: Sequence[float]) -> tuple[float, float]:
    """Mean and standard deviation (of the whole, which is the likeliest one)."""
    mean = fsum(values) / len(values)
    return mean, sqrt(fsum((value - mean) ** 2 for value in values) / len(values))


def _spread(std: float) -> float:
    if std == 0:
        raise InvalidInput("all gaps are alike", "Learn from a longer period, with gaps that differ.")
    return std
