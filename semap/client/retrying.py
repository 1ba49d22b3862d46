"""When a request is sent again.

After 429 always: it was not carried out. After 503, or where the connection broke, only if doing it twice is
the same as doing it once; where it cannot have arrived, always.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from http import HTTPStatus

from semap.client.exchange import SAFE, Answer, Lost, Pause, Plan, Request, T, Told
from semap.client.problem import retry_after_s

FIRST_WAIT_S = 0.2
LONGEST_WAIT_S = 5.0


def patiently(plan: Plan[T], retries: int, spread: Callable[[], float] = random.random) -> Plan[T]:
    """The same plan, each request of which is sent again up to `retries` times where that may help.

    spread  0 to 1, by which waits differ, so that many clients do not come back at once
    """
    told: Told = None
    while True:
        try:
            step = plan.send(told)
        except StopIteration as end:
            value: T = end.value
            return value
        told = yield step
        if not isinstance(step, Request):
            continue
        for attempt in range(retries):
            wait_s = _wait_s(step, told, attempt)
            if wait_s is None:
                break
            yield Pause(wait_s * (1 + spread() / 4))
            told = yield step


def backoff_s(attempt: int) -> float:
    """0.2 s, then twice as long each time, up to 5 s."""
    return min(FIRST_WAIT_S * 2.0 ** min(attempt, 10), LONGEST_WAIT_S)


def _wait_s(request: Request, told: Told, attempt: int) -> float | None:
    """None: the request is not to be sent again."""
    harmless = request.method in SAFE or request.repeatable
    if isinstance(told, Lost):
        return backoff_s(attempt) if harmless or told.unsent else None
    if not isinstance(told, Answer):
        return None
    if told.status == HTTPStatus.TOO_MANY_REQUESTS:
        return max(retry_after_s(told.headers), backoff_s(attempt))
    if told.status == HTTPStatus.SERVICE_UNAVAILABLE and harmless:
        return max(retry_after_s(told.headers), backoff_s(attempt))
    return None
