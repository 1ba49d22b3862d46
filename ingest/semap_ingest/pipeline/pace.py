"""When a record is due: as fast as it goes, or at the pace of the recording."""

from __future__ import annotations

import time
from threading import Event as Signal


class Pace:
    """Mutable: the first record is due at once, and the rest follow it as they were sent.

    speed  so many times as fast as it happened; None: everything is due at once
    """

    def __init__(self, speed: float | None) -> None:
        self._speed = speed
        self._first_us: int | None = None
        self._started_s = 0.0

    def wait(self, sent_us: int, stop: Signal) -> None:
        """Wait until the record that was sent then is due."""
        if self._first_us is None:
            self._first_us, self._started_s = sent_us, time.monotonic()
        if self._speed is not None:
            wait_s = self.due_s(sent_us) - time.monotonic()
            if wait_s > 0:
                stop.wait(wait_s)

    def due_s(self, sent_us: int) -> float:
        """When a record is due, on the monotonic clock [s]; whether it was handed over in time does not
        count."""
        if self._first_us is None or self._speed is None:
            return time.monotonic()
        return self._started_s + (sent_us - self._first_us) / 1e6 / self._speed
