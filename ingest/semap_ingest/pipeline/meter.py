"""Where the time goes, by role. The pipeline itself knows no clock: one is lent to it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

Meter = Callable[[str], AbstractContextManager[None]]
"""Called with the name of a role; the time within the context is that role's."""


def no_meter(role: str) -> AbstractContextManager[None]:
    """Measures nothing."""
    return nullcontext()


class StopWatch:
    """Mutable: seconds and calls by role."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}

    @contextmanager
    def __call__(self, role: str) -> Iterator[None]:
        started_s = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[role] = self.seconds.get(role, 0.0) + time.perf_counter() - started_s
            self.calls[role] = self.calls.get(role, 0) + 1
