"""How often each caller asks: a bucket of requests that fills again steadily (token bucket).

Answers tell what is left in the headers RateLimit and RateLimit-Policy
(draft-ietf-httpapi-ratelimit-headers-10).
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass

BURST = 4
"""A caller who was quiet may ask for so many seconds' worth at once."""

MOST_CALLERS = 10_000


@dataclass(frozen=True)
class Allowance:
    """What a caller has left: whole requests, and how long until there is one (0 if there is)."""

    left: int
    wait_s: float

    @property
    def retry_after_s(self) -> int:
        return max(1, math.ceil(self.wait_s))


class Buckets:
    """A bucket for each of the callers that asked last; time is passed in."""

    def __init__(self, rate_per_s: float, most_callers: int = MOST_CALLERS) -> None:
        self.rate_per_s = rate_per_s
        self.size = max(1.0, rate_per_s * BURST)
        self._most_callers = most_callers
        self._filled: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, caller: str, now_s: float) -> Allowance:
        """Take one request out of a caller's bucket, if there is one."""
        level = self._level(caller, now_s)
        if level < 1:
            self._keep(caller, level, now_s)
            return Allowance(0, (1 - level) / self.rate_per_s)
        self._keep(caller, level - 1, now_s)
        return Allowance(int(level - 1), 0.0)

    def policy(self) -> str:
        """The value of RateLimit-Policy."""
        return f'"requests";q={int(self.size)};w={max(1, math.ceil(self.size / self.rate_per_s))}'

    def state(self, allowance: Allowance) -> str:
        """The value of RateLimit: what is left, and when the bucket is full again."""
        full_s = (self.size - allowance.left) / self.rate_per_s
        return f'"requests";r={allowance.left};t={max(1, math.ceil(full_s))}'

    def _level(self, caller: str, now_s: float) -> float:
        level, at_s = self._filled.get(caller, (self.size, now_s))
        return min(self.size, level + (now_s - at_s) * self.rate_per_s)

    def _keep(self, caller: str, level: float, now_s: float) -> None:
        self._filled[caller] = (level, now_s)
        self._filled.move_to_end(caller)
        if len(self._filled) > self._most_callers:
            self._filled.popitem(last=False)
