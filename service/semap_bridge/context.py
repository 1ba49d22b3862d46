"""What an adapter knows of the bridge that it is in, and what is counted of it."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TypeVar

from semap_ingest.named_states import Refused
from sqlalchemy import Connection, Engine

from semap.store.database.connection import translated
from semap.store.motion.bridges import BridgeReport

log = logging.getLogger(__name__)

ROLE = "semap_ingest"
"""Which reads everything, and writes what sources say."""
TOLD = 5
"""So many refusals of a reason are told, one where each says the same; the others are counted."""
REASONS = 50
"""So many reasons are told apart."""

T = TypeVar("T")


@dataclass
class Figures:
    """Mutable: what is counted since the bridge was started (`BridgeReport`).

    troubles  whom it waits for, and why
    """

    ended: bool = False
    troubles: dict[str, str] = field(default_factory=dict)
    lag_s: float | None = None
    received: int = 0
    committed: int = 0
    delivered: int = 0
    dropped: int = 0
    reconnects: int = 0
    refusals: Counter[str] = field(default_factory=Counter)
    started_at: datetime = field(default_factory=lambda: datetime.now(UTC))

    def report(self, kind: str) -> BridgeReport:
        """As it is now."""
        return BridgeReport(
            kind,
            "ended" if self.ended else "waiting" if self.troubles else "connected",
            "; ".join(f"{whom}: {said}" for whom, said in self.troubles.items()),
            self.lag_s,
            self.received,
            self.committed,
            self.delivered,
            self.dropped,
            self.refusals.total(),
            self.reconnects,
            dict(self.refusals),
            self.started_at,
        )


@dataclass
class Context:
    """Mutable by its figures.

    map_name, name  of the bridge; source: of its states
    engine          of the database, as the role semap_ingest, which reads everything
    threads         in which the database is asked
    only_looks      for `semap bridge check`: nothing may be written, and no bridge that runs be disturbed
    """

    map_name: str
    name: str
    source: str
    engine: Engine
    threads: ThreadPoolExecutor
    figures: Figures = field(default_factory=Figures)
    only_looks: bool = False

    async def ask(self, question: Callable[[Connection], T]) -> T:
        """Ask the database, in a thread and a transaction of its own; raises ServerUnavailable."""

        def run() -> T:
            with translated(), self.engine.begin() as connection:
                return question(connection)

        return await self.in_thread(run)

    async def in_thread(self, work: Callable[[], T]) -> T:
        """Let a thread do what would keep the loop."""
        return await asyncio.get_running_loop().run_in_executor(self.threads, work)

    async def in_thread_to_its_end(self, work: Callable[[], T]) -> T:
        """The same; who is cancelled meanwhile waits, so that nobody closes what the thread uses."""
        done = asyncio.get_running_loop().run_in_executor(self.threads, work)
        try:
            return await asyncio.shield(done)
        except asyncio.CancelledError:
            await asyncio.wait({done})
            raise

    def refuse(self, reason: str, detail: str = "") -> None:
        """Count a record that cannot be used; the first of each reason are told."""
        refusals = self.figures.refusals
        key = reason if reason in refusals or len(refusals) < REASONS else "other"
        refusals[key] += 1
        told = TOLD if detail else 1
        if refusals[key] <= told:
            more = "; further ones are only counted" if refusals[key] == told else ""
            log.warning("%s: refused: %s%s%s", self.name, reason, f": {detail}" if detail else "", more)

    def refuse_all(self, refused: Iterable[Refused]) -> None:
        """The same for many."""
        for each in refused:
            self.refuse(each.reason, each.detail)

    def drop(self, count: int = 1) -> None:
        """Count records that came live and could not be kept."""
        if not self.figures.dropped:
            log.warning("%s: records are dropped, since they come faster than they are taken in", self.name)
        self.figures.dropped += count
