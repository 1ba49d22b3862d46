"""Both halves of the engine in one process: steps of the log in, events out."""

from __future__ import annotations

import psycopg

from semap.errors import Conflict
from semap.intake.stretch import Stretch
from semap.model.event import Event
from semap.replication.pgoutput import Transaction
from semap.rules.engine.step import MapGone
from semap.worker.progress import Made, Progress, commit_progress


class Making:
    """Mutable: what a stretch of the log has made since the last commit.

    raises Conflict where the rules run elsewhere
    """

    def __init__(self, connection: psycopg.Connection, stretch: Stretch, progress: Progress) -> None:
        if progress.published_as is not None:
            raise Conflict(
                f"The rules of this database run elsewhere: it is published as {progress.published_as}.",
                "Run `semap publish` instead of `semap work`.",
            )
        self.progress = progress
        self._stretch = stretch
        self._events: list[Event] = []
        self._gone_maps: list[int] = []

    def has_made(self) -> bool:
        """Whether somebody waits for what was made."""
        return bool(self._events or self._gone_maps)

    def commit(self, connection: psycopg.Connection, before_lsn: int) -> int:
        """Write it; gives the number of the last event there is."""
        newest = commit_progress(connection, before_lsn, self.progress, Made(self._events, self._gone_maps))
        self._events, self._gone_maps = [], []
        return newest

    def take(self, transaction: Transaction, now_s: float) -> None:
        """raises as `Stretch.steps`"""
        for step in self._stretch.steps(transaction, now_s, self._events):
            if isinstance(step, MapGone):
                self._gone_maps.append(step.map_id)
                self._events[:] = [event for event in self._events if event.map_id != step.map_id]
            self._events += self.progress.take(step)
