"""New events for everyone who waits for them, read once for the whole process.

One connection listens on the channel `semap_event`; a notification only wakes. What is new is then read
by number into a ring of bounded size. Readers have a cursor, the number of the last event that they
know, and take what is after it at their own pace: from the ring, or from the database where the ring
has moved on. So a slow reader costs nothing and misses nothing.

A notification may get lost with its connection, so new events are looked for every second as well, and
after each reconnection.
"""

from __future__ import annotations

import asyncio
import logging
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass

import psycopg
from sqlalchemy import Engine

from semap.errors import SemapError
from semap.store.database import connect, translated
from semap.store.events import StoredEvent, list_events, newest_event
from semap_service.transaction import transaction

log = logging.getLogger(__name__)

RING_SIZE = 10_000
BATCH = 1000
POLL_S = 1.0
FIRST_RETRY_S = 0.05
LAST_RETRY_S = 2.0


@dataclass(frozen=True)
class Selection:
    """Which events a reader wants; None: any."""

    map: str | None = None
    type: str | None = None
    rule: str | None = None

    def takes(self, event: StoredEvent) -> bool:
        return (
            self.map in (None, event.map)
            and self.type in (None, event.type)
            and self.rule in (None, event.rule)
        )


@dataclass(frozen=True)
class Page:
    """Events in their order, and the cursor up to which nothing else was selected."""

    events: tuple[StoredEvent, ...]
    cursor: int
    is_full: bool


class Feed:
    """The ring holds every event with a number in (floor, head]."""

    def __init__(self, engine: Engine, dsn: str, ring_size: int = RING_SIZE) -> None:
        self.connected = False
        self.head = 0
        self._engine = engine
        self._dsn = dsn
        self._ring_size = ring_size
        self._ring: list[StoredEvent] = []
        self._floor: int | None = None
        self._news = asyncio.Event()

    async def run(self) -> None:
        """Follow the database until cancelled; a lost server is awaited."""
        wait_s = FIRST_RETRY_S
        while True:
            try:
                await self._follow()
            except SemapError as error:
                if self.connected or wait_s == FIRST_RETRY_S:
                    log.warning("The feed of events waits for the database: %s", error)
            except Exception:
                log.exception("The feed of events failed; it begins again")
            wait_s = FIRST_RETRY_S if self.connected else wait_s
            self.connected = False
            await asyncio.sleep(wait_s)
            wait_s = min(wait_s * 2, LAST_RETRY_S)

    async def read(self, after: int, limit: int, selection: Selection) -> Page:
        """At most `limit` selected events after a cursor.

        raises  ServerUnavailable if the database is needed and does not answer
        """
        if self._floor is None or after < self._floor:
            return await asyncio.to_thread(self.read_stored, after, limit, selection)
        known = self._ring[bisect_right(self._ring, after, key=_number) :]
        events: list[StoredEvent] = []
        for event in known:
            if selection.takes(event):
                events.append(event)
                if len(events) == limit:
                    return Page(tuple(events), event.seq, is_full=True)
        return Page(tuple(events), max(after, self.head), is_full=False)

    def read_stored(self, after: int, limit: int, selection: Selection) -> Page:
        """The same from the database."""
        with transaction(self._engine) as connection:
            newest = newest_event(connection)
            events = list_events(
                connection,
                after=after,
                limit=limit,
                map_name=selection.map,
                event_type=selection.type,
                rule_name=selection.rule,
            )
        last = events[-1].seq if events else after
        is_full = len(events) == limit
        return Page(events, last if is_full else max(last, newest), is_full)

    async def wait(self, cursor: int, timeout_s: float) -> bool:
        """Whether there are events after a cursor, now or before the time is over."""
        try:
            async with asyncio.timeout(timeout_s):
                while self.head <= cursor:
                    await self._news.wait()
        except TimeoutError:
            return False
        return True

    async def _follow(self) -> None:
        listener = await asyncio.to_thread(connect, self._dsn, "semap_api", application="semap feed")
        try:
            with translated():
                await asyncio.to_thread(listener.execute, "listen semap_event")
            await self._align()
            self.connected = True
            while True:
                await self._take_new()
                await _notified(listener)
        finally:
            listener.close()

    async def _align(self) -> None:
        """Begin at the newest event, or go on where the ring ends if the database is still the same."""
        newest = await asyncio.to_thread(self._newest)
        if self._floor is None or newest < self.head:
            self._ring.clear()
            self._floor = self.head = newest
            self._wake()

    async def _take_new(self) -> None:
        while True:
            events = await asyncio.to_thread(self._new_events)
            if events:
                self._append(events)
            if len(events) < BATCH:
                return

    def _append(self, events: Iterable[StoredEvent]) -> None:
        self._ring.extend(events)
        excess = len(self._ring) - self._ring_size
        if excess > 0:
            self._floor = self._ring[excess - 1].seq
            del self._ring[:excess]
        self.head = self._ring[-1].seq
        self._wake()

    def _wake(self) -> None:
        news, self._news = self._news, asyncio.Event()
        news.set()

    def _newest(self) -> int:
        with transaction(self._engine) as connection:
            return newest_event(connection)

    def _new_events(self) -> tuple[StoredEvent, ...]:
        with transaction(self._engine) as connection:
            return list_events(connection, after=self.head, limit=BATCH)


def _number(event: StoredEvent) -> int:
    return event.seq


async def _notified(listener: psycopg.Connection) -> None:
    """Wait for a notification, for a second at most.

    raises  ServerUnavailable if the connection is lost
    """
    loop = asyncio.get_running_loop()
    readable = asyncio.Event()
    with translated():
        socket = listener.fileno()
        loop.add_reader(socket, readable.set)
        try:
            await asyncio.wait_for(readable.wait(), POLL_S)
        except TimeoutError:
            return
        finally:
            loop.remove_reader(socket)
        for _ in listener.notifies(timeout=0):
            pass
