"""Up to when all is there of a live source: rules wait for that, so it is said with the states, once true.

What is stamped as it comes is complete at once, and goes on with the clock. Of what is stamped by its sender,
stamps come in order; at the newest one there may be more, until nothing has come for a moment.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Generic, TypeVar

from semap.timeline.stamp import to_us
from semap_bridge.adapter import Batch

HEARTBEAT_S = 1.0
MOST_TIMES = 5
"""While more and more comes, so many times as long is waited at most."""

T = TypeVar("T")


class Completeness(Generic[T]):
    """Mutable: what came and is not written yet, and up to which stamp [us] the source is complete.

    source    None: that of the bridge
    settle_s  how long to wait for others of the newest stamp; None: stamps are those of this machine
    """

    def __init__(self, source: str | None, settle_s: float | None) -> None:
        self._source, self._settle_s = source, settle_s
        self._arrived_us = self._newest_us = 0
        self._gathered: list[T] = []
        self._is_settled = True
        self._since_s = 0.0
        self._due_s = time.monotonic()

    @property
    def follows_clock(self) -> bool:
        return self._settle_s is None

    def arrival_us(self) -> int:
        """A stamp of this machine, after all before."""
        self._arrived_us = max(_now_us(), self._arrived_us + 1)
        return self._arrived_us

    def gather(self, came: Sequence[T]) -> None:
        """What came, in its order."""
        if came:
            now_s = time.monotonic()
            self._since_s = self._since_s if self._gathered else now_s
            self._due_s = now_s + (self._settle_s or 0.0)
            self._gathered += came

    def due_in_s(self) -> float:
        """When to ask `ready` again, if nothing comes."""
        if self._settle_s is not None and not self._gathered:
            return HEARTBEAT_S
        return max(0.0, self._due_s - time.monotonic())

    def ready(self) -> list[T] | None:
        """What is to be written now, which may be nothing but that the clock went on; None: nothing."""
        now_s = time.monotonic()
        settle_s = self._settle_s
        self._is_settled = now_s >= self._due_s
        waited_long = settle_s is not None and now_s - self._since_s >= MOST_TIMES * settle_s
        if (settle_s is not None and not self._gathered) or not (self._is_settled or waited_long):
            return None
        ready, self._gathered = self._gathered, []
        self._due_s = now_s + HEARTBEAT_S
        return ready

    def take(self, batch: Batch) -> Batch:
        """What was ready, with what is complete by it: a stamp that lies ahead says nothing."""
        if self._settle_s is None:
            until_us = self._arrived_us if batch.records else self.arrival_us()
        else:
            now_us = _now_us()
            stamps = [
                *(int(each) for each in batch.states.stamp_us),
                *(to_us(each.stamp) for each in batch.objects),
                *(stamp_us for _, stamp_us in batch.ended),
            ]
            self._newest_us = max([self._newest_us, *(each for each in stamps if each <= now_us)])
            until_us = self._newest_us - (not self._is_settled)
        return replace(batch, source=self._source, watermark_us=until_us if until_us > 0 else None)


def _now_us() -> int:
    return to_us(datetime.now(UTC))
