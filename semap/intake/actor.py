"""Who did it: which track most likely caused the new state of an object.

Who handles an object stands about an arm's length from it, and where a track is is known with a standard
deviation of its own. A track's distance is taken as normally distributed around 0 with both together, so that
the limit of the distance is two deviations away. That nobody who is seen did it is as likely as if somebody
whose place is known exactly had done it from that limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

USUAL_STD_M = 0.3
REACH_SHARE = 0.5
"""Of the greatest distance: the standard deviation of where somebody stands who handles the object."""


@dataclass(frozen=True)
class Candidate:
    """A track near an object; std_m is the deviation of its position, None where that is not known."""

    track_id: int
    name: str
    distance_m: float
    std_m: float | None


@dataclass(frozen=True)
class Actor:
    """The likeliest candidate; the likelihoods of all candidates and of nobody are 1 together."""

    candidate: Candidate
    likelihood: float


def likeliest(candidates: Sequence[Candidate], within_m: float) -> Actor | None:
    """The actor among candidates up to `within_m` away; None where there is none.

    Of two that are as likely the one with the lesser name, then id.
    """
    near = [candidate for candidate in candidates if candidate.distance_m <= within_m]
    if not near:
        return None
    reach_m = REACH_SHARE * within_m
    logs = [_log_density(each.distance_m, math.hypot(reach_m, _std_m(each))) for each in near]
    nobody = _log_density(within_m, reach_m)
    most = max(*logs, nobody)
    total = sum(math.exp(log - most) for log in (*logs, nobody))
    log, candidate = min(
        zip(logs, near, strict=True), key=lambda pair: (-pair[0], pair[1].name, pair[1].track_id)
    )
    return Actor(candidate, math.exp(log - most) / total)


def _std_m(candidate: Candidate) -> float:
    return candidate.std_m if candidate.std_m is not None and candidate.std_m > 0 else USUAL_STD_M


def _log_density(distance_m: float, std_m: float) -> float:
    """Of the normal distribution, without the factor that is common to all."""
    return -0.5 * (distance_m / std_m) ** 2 - math.log(std_m)
