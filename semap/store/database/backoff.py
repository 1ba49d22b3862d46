"""Waiting for a server that cannot do its work now, without silence: what it said, and what waits for it."""

from __future__ import annotations

import logging
import time
from threading import Event as Signal

FIRST_RETRY_S = 0.05
LAST_RETRY_S = 2.0
SAID_AGAIN_S = 60.0


class Reminder:
    """Mutable: what was said of a trouble. Said is what is new, and once a minute what lasts."""

    def __init__(self, log: logging.Logger, waits: str) -> None:
        self._log = log
        self._waits = waits
        self._said = ""
        self._said_s = 0.0

    def say(self, error: Exception, level: int = logging.WARNING) -> None:
        """The error in the words of who raised it, what waits, and what to do about it."""
        now_s = time.monotonic()
        if str(error) == self._said and now_s < self._said_s + SAID_AGAIN_S:
            return
        self._said, self._said_s = str(error), now_s
        remedy = getattr(error, "remedy", "")
        self._log.log(level, "%s: %s%s", self._waits, error, f" ({remedy})" if remedy else "")

    def over(self) -> None:
        """All is well again: the next trouble is a new one."""
        if self._said:
            self._log.info("%s no more.", self._waits)
            self._said = ""


class Patience:
    """Mutable: how long to wait before the next try: longer each time, up to two seconds."""

    def __init__(self, log: logging.Logger, waits: str) -> None:
        self._reminder = Reminder(log, waits)
        self._wait_s = FIRST_RETRY_S

    def wait(self, error: Exception, stop: Signal, level: int = logging.WARNING) -> bool:
        """Say what is wrong, and wait a while; whether `stop` was set."""
        self._reminder.say(error, level)
        is_stopped = stop.wait(self._wait_s)
        self._wait_s = min(self._wait_s * 2, LAST_RETRY_S)
        return is_stopped

    def restored(self) -> None:
        """It did its work."""
        self._reminder.over()
        self._wait_s = FIRST_RETRY_S
