"""Waiting for a peer or the database that is away: said once in plain words, and again when it is back."""

from __future__ import annotations

import asyncio
import logging
import random
import time

from semap.store.database.backoff import FIRST_RETRY_S, LAST_RETRY_S, Reminder
from semap_bridge.context import Context

log = logging.getLogger(__name__)

STEADY_S = 10.0
"""Who is lost again sooner is waited for as before."""


class Pause:
    """Mutable: how long to wait for somebody, and what was said of it.

    whom  the peer, or the database
    """

    def __init__(self, context: Context, whom: str) -> None:
        self._context, self._whom = context, whom
        self._reminder = Reminder(log, f"{context.name} waits for {whom}")
        self._wait_s = FIRST_RETRY_S
        self._since_s: float | None = None
        self._back_s: float | None = None

    async def after(self, error: Exception) -> None:
        """Say what is wrong, if it is new, and wait a while: longer each time, and not all at one time."""
        now_s = time.monotonic()
        if self._back_s is not None and now_s - self._back_s > STEADY_S:
            self._reminder.over()
            self._wait_s = FIRST_RETRY_S
        self._back_s = None
        self._since_s = self._since_s or now_s
        self._reminder.say(error)
        self._context.figures.troubles[self._whom] = str(error)
        await asyncio.sleep(self._wait_s * random.uniform(0.5, 1.5))  # noqa: S311  (no secret)
        self._wait_s = min(self._wait_s * 2, LAST_RETRY_S)

    def over(self) -> None:
        """It is there."""
        if self._since_s is not None:
            log.warning(
                "%s: %s is back after %.1f s",
                self._context.name,
                self._whom,
                time.monotonic() - self._since_s,
            )
        self._since_s, self._back_s = None, time.monotonic()
        self._context.figures.troubles.pop(self._whom, None)
