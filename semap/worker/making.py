"""Both halves of the engine in one process: steps of the log in, events out."""

from __future__ import annotations

from semap.intake.stretch import Stretch
from semap.model.event import Event
from semap.replication.pgoutput import Transaction
from semap.rules.engine.step import MapGone
from semap.worker.progress import Made, Progress


class Making:
    """Mutable: what a stretch of the log has made since the last commit."""

    def __init__(self, stretch: Stretch, progress: Progress) -> None:
        self.progress = progress
        self._stretch = stretch
        self._events: list[Event] = []
        self._gone_maps: list[int] = []

    @property
    def made(self) -> Made:
        return Made(tuple(self._events), tuple(self._gone_maps))

    def begin(self) -> None:
        """What was made is committed; another stretch begins."""
        self._events, self._gone_maps = [], []

    def take(self, transaction: Transaction, now_s: float) -> None:
        """raises as `Stretch.steps`"""
        for step in self._stretch.steps(transaction, now_s, self._events):
            if isinstance(step, MapGone):
                self._gone_maps.append(step.map_id)
                self._events[:] = [event for event in self._events if event.map_id != step.map_id]
            self._events += self.progress.take(step)
