"""From a source to the database: a bounded queue, and one transaction for states, watermark and position.

What comes live and finds the queue full drives out the oldest, which is counted. A source that has positions
is not read on meanwhile. What waits is written together, so that what waited for a database is soon in.

Where the answer to a commit is lost, the position tells whether it was done. States without a position are
written again, which is harmless, since one that is stored is passed over.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime

from semap_ingest.named_states import NamedStates, sifted, without_repeats
from semap_ingest.state_intake import Said, StateIntake, Taken
from sqlalchemy import Connection

from semap.errors import Conflict, InvalidInput, ServerUnavailable
from semap.store.motion.bridges import Place, Position, move_position, read_position
from semap.timeline.stamp import to_us
from semap_bridge.adapter import Batch, Settings, Source
from semap_bridge.context import Context
from semap_bridge.pausing import Pause

TOGETHER = 5_000
"""So many records are written in one transaction at most, if one batch is not more; with 20,000 the triggers
take up to twice as long for each."""


class Intake:
    """Mutable: what waits. It outlives the connections to the peer, so that what came in is written."""

    def __init__(self, context: Context, settings: Settings, states: StateIntake) -> None:
        self._context = context
        self._settings = settings
        self._states = states
        self.map_id = states.map_id
        self._place = Place(states.map_id, context.name, "in")
        self._waiting: deque[tuple[float, Batch]] = deque()
        self._records = 0
        self._in_hand: Sequence[Batch] = ()
        self._changed = asyncio.Event()
        self._position: Position | None = None
        self._source: Source | None = None

    async def read(self, source: Source) -> None:
        """Take what a source yields, until it is done."""
        await self.drained()
        self._position = await self._context.ask(lambda c: read_position(c, self._place))
        self._source = source
        try:
            async for batch in source.batches(self._position):
                self._context.figures.received += batch.records
                self._context.refuse_all(batch.refused)
                usable = self._sifted(batch)
                if not usable.is_empty:
                    await self._put(usable)
            await self.drained()
            await self._context.ask(lambda c: self._states.end(c, self._context.source))
        finally:
            self._source = None

    async def drained(self) -> None:
        """Wait until all that came in is written."""
        while self._waiting or self._in_hand:
            await self._news()

    async def write(self) -> None:
        """Write what waits, until cancelled.

        raises  Conflict where somebody else moved the position; NotFound where the map is gone
        """
        pause = Pause(self._context, "the database")
        while True:
            while not self._waiting:
                await self._news()
            since_s, self._in_hand = self._first()
            said = self._said(self._in_hand)
            was_tried = False
            while True:
                try:
                    await self._commit(said, self._in_hand, was_tried)
                    break
                except ServerUnavailable as error:
                    self._context.figures.lag_s = time.monotonic() - since_s
                    was_tried = True
                    await pause.after(error)
            pause.over()
            self._context.figures.lag_s = time.monotonic() - since_s
            await self._acknowledge(self._in_hand)
            self._in_hand = ()
            self._wake()

    async def _put(self, batch: Batch) -> None:
        while self._waiting and self._records + len(batch) > self._settings.queue:
            if batch.position is not None:
                await self._news()
                continue
            _, oldest = self._waiting.popleft()
            self._records -= len(oldest)
            self._context.drop(len(oldest))
        self._waiting.append((time.monotonic(), batch))
        self._records += len(batch)
        self._wake()

    def _first(self) -> tuple[float, list[Batch]]:
        """Take the first that wait, together; since when the oldest did."""
        since_s, first = self._waiting.popleft()
        batches, records = [first], len(first)
        while self._waiting and records + len(self._waiting[0][1]) <= TOGETHER:
            batches.append(self._waiting.popleft()[1])
            records += len(batches[-1])
        self._records -= records
        self._wake()
        return since_s, batches

    async def _commit(self, said: Sequence[Said], batches: Sequence[Batch], was_tried: bool) -> None:
        """was_tried: it may have been committed already, and its answer lost."""
        was = self._position
        now = next((each.position for each in reversed(batches) if each.position is not None), was)

        def write(connection: Connection, put: Put) -> list[Taken]:
            taken = put(connection, said)
            if now is not None and now != was:
                move_position(connection, self._place, was, now)
            return taken

        if was_tried:
            self._states.forget()
            if now != was and await self._context.ask(lambda c: read_position(c, self._place)) == now:
                self._position = now
                return
        try:
            if not all(self._states.is_prepared(each) for each in said):
                await self._context.ask(lambda c: self._prepare(c, said))
            taken = await self._context.ask(lambda c: write(c, self._states.write))
        except (Conflict, InvalidInput):
            self._states.forget()
            await self._context.ask(lambda c: self._prepare(c, said))
            taken = await self._context.ask(lambda c: write(c, self._states.write_some))
        self._position = now
        for each in taken:
            self._context.figures.committed += each.stored
            self._context.refuse_all(each.refused)

    def _prepare(self, connection: Connection, said: Sequence[Said]) -> None:
        for each in said:
            self._states.prepare(connection, each)

    async def _acknowledge(self, batches: Sequence[Batch]) -> None:
        if self._source is not None and self._position is not None and batches[-1].position is not None:
            await self._source.committed(self._position)

    def _sifted(self, batch: Batch) -> Batch:
        states, refused = sifted(
            batch.states,
            to_us(datetime.now(UTC)),
            ahead_s=self._settings.ahead_s,
            behind_s=self._settings.behind_s,
        )
        self._context.refuse_all(refused)
        return replace(batch, states=states, refused=())

    def _said(self, batches: Sequence[Batch]) -> list[Said]:
        """What was said of each source, in the order of time."""
        by_source: dict[str, list[Batch]] = {}
        for each in batches:
            by_source.setdefault(each.source or self._context.source, []).append(each)
        said = []
        for name, parts in by_source.items():
            states, repeated = without_repeats(NamedStates.joined([each.states for each in parts]))
            self._context.refuse_all(repeated)
            marks = [each.watermark_us for each in parts if each.watermark_us is not None]
            said.append(
                Said(
                    name,
                    states,
                    [one for each in parts for one in each.objects],
                    [one for each in parts for one in each.ended],
                    max(marks, default=None),
                    [each.also for each in parts if each.also is not None],
                )
            )
        return said

    async def _news(self) -> None:
        await self._changed.wait()

    def _wake(self) -> None:
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()


Put = Callable[[Connection, Sequence[Said]], list[Taken]]
