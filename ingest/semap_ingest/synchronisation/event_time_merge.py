"""Records of any number of sources in one order of event time.

What comes out   Every record that is added comes out exactly once: in a moment, which is all that has the
    same stamp, or refused. Moments come in the order of their stamps.
When             As soon as no source can send anything older: each is taken to send nothing before its last
    stamp and its least period, nor before the newest stamp of any source less its own patience. So a source
    that falls silent or is slow is waited for by its patience at most, in event time.
Refused          What comes after its moment: `refused` counts by source.

What comes out depends on the order of records within each source, and on how late one is against the others,
not on when it is called. No clock and no I/O.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from semap_ingest.synchronisation.synchroniser import NEVER_US

T = TypeVar("T")


@dataclass(frozen=True)
class Pace:
    """period_us    no two records of the source are closer than this; 0 where nothing is known
    patience_us  how far the source may be behind the newest of all
    """

    period_us: int
    patience_us: int


@dataclass(frozen=True, eq=False)
class Moment(Generic[T]):
    """items  by the order in which their sources were named"""

    stamp_us: int
    items: tuple[T, ...]


class EventTimeMerge(Generic[T]):
    """Mutable: what waits for older records, and how far each source has come."""

    def __init__(self, sources: Mapping[str, Pace]) -> None:
        self.refused: Counter[str] = Counter()
        self._sources = sources
        self._rank = {source: rank for rank, source in enumerate(sources)}
        self._frontier_us = dict.fromkeys(sources, NEVER_US)
        self._waiting: list[tuple[int, int, int, T]] = []
        self._count = 0

    @property
    def watermark_us(self) -> int:
        """No moment at or before it comes any more; NEVER_US as long as nothing is certain."""
        return max(NEVER_US, min(self._frontier_us.values(), default=NEVER_US) - 1)

    def add(self, source: str, stamp_us: int, item: T) -> None:
        """A record waits; `take` gives those whose wait is over."""
        if stamp_us <= self.watermark_us:
            self.refused[source] += 1
            return
        heapq.heappush(self._waiting, (stamp_us, self._rank[source], self._count, item))
        self._count += 1
        # who is alone is waited for by nobody
        period_us = self._sources[source].period_us if len(self._sources) > 1 else 0
        self.reach(source, stamp_us + max(1, period_us))

    def reach(self, source: str, frontier_us: int) -> None:
        """The source sends nothing before it any more."""
        self._frontier_us[source] = max(self._frontier_us[source], frontier_us)

    def come_to(self, stamp_us: int) -> None:
        """Some source has come to this stamp: others are waited for by their patience."""
        for source, pace in self._sources.items():
            self.reach(source, stamp_us - pace.patience_us)

    def take(self) -> list[Moment[T]]:
        """The moments that are complete."""
        moments: list[Moment[T]] = []
        while self._waiting and self._waiting[0][0] <= self.watermark_us:
            stamp_us, items = self._waiting[0][0], []
            while self._waiting and self._waiting[0][0] == stamp_us:
                items.append(heapq.heappop(self._waiting)[3])
            moments.append(Moment(stamp_us, tuple(items)))
        return moments

    def flush(self) -> list[Moment[T]]:
        """All that waits: nothing more is to come up to the latest stamp."""
        latest_us = max((stamp_us for stamp_us, *_ in self._waiting), default=NEVER_US)
        for source in self._sources:
            self.reach(source, latest_us + 1)
        return self.take()
