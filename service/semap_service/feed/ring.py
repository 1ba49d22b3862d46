"""New events for everyone who waits for them, read and written as JSON once for the whole process.

One connection listens on the channel `semap_event`; a notification only wakes. What is new is then read
by number, on a connection of the feed's own, into a ring of bounded size. Readers have a cursor, the number
of the last event that they know, and take what is after it at their own pace: from the ring, or from the
database where the ring has moved on. So a slow reader costs nothing and misses nothing.

A notification may get lost with its connection, so new events are looked for every second as well, and
after each reconnection.
"""

from __future__ import annotations

import asyncio
import logging
from bisect import bisect_right
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import copy_context
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import TypeVar

from sqlalchemy import Engine

from semap.errors import SemapError, ServerUnavailable
from semap.store.database.backoff import Reminder
from semap.store.database.event_number import newest_event
from semap.store.event.cloud_event import event_json
from semap.store.event.event_selection import Selection
from semap.store.event.event_tail import EventTail
from semap.store.event.events import StoredEvent, read_stretch
from semap_service.database.transaction import transaction
from semap_service.http.outlet import MOST_BEHIND

log = logging.getLogger(__name__)

RING_SIZE = MOST_BEHIND
RING_BYTES = 16 * 1024 * 1024
"""Of the events' JSON; what Python needs beside it is a few times that of small events."""
BATCH = 1000
POLL_S = 1.0
TICK_S = 1.0
FIRST_RETRY_S = 0.05
LAST_RETRY_S = 2.0
STOP_S = 2.0
ROLE = "semap_api"
READERS = 4
"""Readers of the past at one time, so that a thousand who come back at once leave connections to others."""

EVERYTHING = Selection()

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Entry:
    """An event, and its document as JSON in UTF-8."""

    event: StoredEvent
    document: bytes

    @classmethod
    def of(cls, event: StoredEvent) -> Entry:
        return cls(event, event_json(event))


@dataclass(frozen=True)
class Page:
    """What was selected, in its order, and the cursor up to which nothing else was.

    is_full  there may be more beyond the cursor already
    """

    entries: tuple[Entry, ...]
    cursor: int
    is_full: bool

    @property
    def events(self) -> tuple[StoredEvent, ...]:
        return tuple(entry.event for entry in self.entries)

    def of_at_most(self, most_bytes: int) -> Page:
        """Its beginning, with no more than so many bytes of documents, but for the first one."""
        size = 0
        for count, entry in enumerate(self.entries):
            size += len(entry.document)
            if count and size > most_bytes:
                kept = self.entries[:count]
                return Page(kept, kept[-1].event.seq, is_full=True)
        return self


class Feed:
    """The ring holds every event with a number in (floor, head].

    clients   who follows at this moment, by kind
    sent      events that were given to clients
    too_slow  clients that were told so and closed
    on_taken  is told, for each read, how old its newest event was [s]

    tick_s      those who wait are woken so often even without news
    beginnings  counts the databases that were followed: after a restored copy, numbers mean other events
    """

    def __init__(
        self,
        engine: Engine,
        dsn: str,
        *,
        tick_s: float = TICK_S,
        ring_size: int = RING_SIZE,
        ring_bytes: int = RING_BYTES,
    ) -> None:
        self.connected = False
        self.beginnings = 0
        self.head = 0
        self.clients: Counter[str] = Counter()
        self.sent = 0
        self.too_slow = 0
        self.on_taken: Callable[[float], None] | None = None
        self._engine = engine
        self._dsn = dsn
        self._own_heads: dict[str, int] = {}
        self._tick_s = tick_s
        self._ring_size = ring_size
        self._ring_bytes = ring_bytes
        self._ring: list[Entry] = []
        self._bytes = 0
        self._floor: int | None = None
        self._news = asyncio.Event()
        self._tail: EventTail | None = None
        self._placing = 0
        self._unplaced = 0
        self._own_thread = ThreadPoolExecutor(1, "feed")
        self._readers = ThreadPoolExecutor(READERS, "feed reader")

    async def run(self) -> None:
        """Follow the database until cancelled; a lost server is awaited."""
        wait_s = FIRST_RETRY_S
        reminder = Reminder(log, "The feed of events waits for the database")
        ticking = asyncio.create_task(self._tick())
        try:
            while True:
                try:
                    await self._follow()
                except SemapError as error:
                    if self.connected:
                        reminder.over()
                    reminder.say(error)
                except Exception:
                    log.exception("The feed of events failed; it begins again")
                wait_s = FIRST_RETRY_S if self.connected else wait_s
                self.connected = False
                await asyncio.sleep(wait_s)
                wait_s = min(wait_s * 2, LAST_RETRY_S)
        finally:
            ticking.cancel()
            # A thread that still reads would give its connection back to an engine that is disposed.
            with suppress(TimeoutError):
                async with asyncio.timeout(STOP_S):
                    for threads in (self._own_thread, self._readers):
                        await asyncio.to_thread(threads.shutdown, cancel_futures=True)
            self._hang_up()

    @contextmanager
    def following(self, kind: str) -> Iterator[None]:
        """Count a client as long as it follows."""
        self.clients[kind] += 1
        try:
            yield
        finally:
            self.clients[kind] -= 1

    @contextmanager
    def placing(self, selection: Selection) -> Iterator[None]:
        """Know the places of new events as long as somebody selects by them."""
        self._placing += selection.asks_places
        try:
            yield
        finally:
            self._placing -= selection.asks_places

    def head_of(self, selection: Selection) -> int:
        """The number of the newest event, as the reader of a selection is told it."""
        own_of = selection.own_of
        return self.head if own_of is None else self._own_heads.get(own_of, 0)

    async def read(self, after: int, limit: int, selection: Selection) -> Page:
        """At most `limit` selected events after a cursor.

        raises  ServerUnavailable if the database is needed and does not answer
        """
        return await self.look(after, limit, selection) or await self.read_past(after, limit, selection)

    async def look(self, after: int, limit: int, selection: Selection) -> Page | None:
        """What is `known`; a filter is tried on many events by a thread, since it may be long."""
        if selection.filter is None:
            return self.known(after, limit, selection)
        rest, head = self._after(after, selection), self.head_of(selection)
        return None if rest is None else await self.ask(partial(_chosen, rest, after, head, limit, selection))

    def known(self, after: int, limit: int, selection: Selection) -> Page | None:
        """The same from the ring; None where it has moved on, or where it lacks places that are asked for."""
        rest = self._after(after, selection)
        return None if rest is None else _chosen(rest, after, self.head_of(selection), limit, selection)

    def _after(self, after: int, selection: Selection) -> list[Entry] | None:
        if self._floor is None:
            return None
        unplaced = self._unplaced if selection.asks_places else 0
        if selection.own_of is not None:
            return self._own_after(after, selection.own_of, unplaced)
        if after < max(self._floor, unplaced):
            return None
        return self._ring[bisect_right(self._ring, after, key=_number) :]

    def _own_after(self, after: int, map_name: str, unplaced: int) -> list[Entry] | None:
        """The same by the numbers of a map, which have no gaps, so that the first tells whether more were."""
        rest: list[Entry] = []
        next_seq = self._own_heads.get(map_name, 0) + 1
        for entry in reversed(self._ring):
            if next_seq == after + 1 or entry.event.seq <= unplaced:
                break
            if entry.event.map == map_name:
                rest.append(entry)
                next_seq = entry.event.own_seq
        return rest[::-1] if next_seq <= after + 1 else None

    async def read_past(self, after: int, limit: int, selection: Selection) -> Page:
        """The same from the database, with what has become of the events since."""
        return await self.ask(partial(self.read_stored, after, limit, selection))

    def read_stored(self, after: int, limit: int, selection: Selection) -> Page:
        """The same, for a thread."""
        with transaction(self._engine) as connection:
            newest = newest_event(connection, selection.own_of)
            stretch = read_stretch(
                connection,
                after=after,
                limit=limit,
                map_name=selection.own_of or selection.map,
                event_type=selection.type,
                rule_name=selection.rule,
                own=selection.own_of is not None,
            )
        entries = tuple(Entry.of(event) for event in stretch.events if selection.takes(event))
        last = stretch.last if stretch.is_full else max(stretch.last, newest)
        return Page(entries, last, stretch.is_full)

    async def ask(self, question: Callable[[], T]) -> T:
        """Let one of few threads, in the caller's context, ask the database."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._readers, partial(copy_context().run, question))

    async def wait(self, cursor: int, timeout_s: float, selection: Selection = EVERYTHING) -> bool:
        """Whether there are events after a cursor, now or before the time is over."""
        try:
            async with asyncio.timeout(timeout_s):
                while self.head_of(selection) <= cursor:
                    await self._news.wait()
        except TimeoutError:
            return False
        return True

    async def news(self) -> None:
        """Return at the next event, or at the next tick."""
        await self._news.wait()

    def _wake(self) -> None:
        news, self._news = self._news, asyncio.Event()
        news.set()

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(self._tick_s)
            self._wake()

    async def _follow(self) -> None:
        try:
            tail = await self._ask_alone(self._begin)
            await self._align()
            self.connected = True
            while True:
                await self._take_new()
                await _notified(tail)
        finally:
            self._hang_up()

    async def _align(self) -> None:
        """Begin at the newest event, or go on where the ring ends if the database is still the same."""
        newest, own_heads = await self._ask_alone(lambda: self._own_tail().newest())
        if self._floor is None or newest < self.head:
            self._ring.clear()
            self._bytes = 0
            self._floor = self.head = self._unplaced = newest
            self._own_heads = own_heads
            self.beginnings += 1
            self._wake()

    async def _take_new(self) -> None:
        while True:
            placed = self._placing > 0
            entries = await self._ask_alone(partial(self._new_entries, placed))
            if entries:
                self._append(entries)
                if not placed:
                    self._unplaced = self.head
                if self.on_taken is not None:
                    age = datetime.now(UTC) - entries[-1].event.created_at
                    self.on_taken(max(age.total_seconds(), 0.0))
            if len(entries) < BATCH:
                return

    def _append(self, entries: Sequence[Entry]) -> None:
        self._ring.extend(entries)
        self._own_heads.update((entry.event.map, entry.event.own_seq) for entry in entries)
        self._bytes += sum(len(entry.document) for entry in entries)
        excess = max(len(self._ring) - self._ring_size, 0)
        self._bytes -= sum(len(entry.document) for entry in self._ring[:excess])
        while self._bytes > self._ring_bytes and excess < len(self._ring) - 1:
            self._bytes -= len(self._ring[excess].document)
            excess += 1
        if excess > 0:
            self._floor = self._ring[excess - 1].event.seq
            del self._ring[:excess]
        self.head = self._ring[-1].event.seq
        self._wake()

    async def _ask_alone(self, question: Callable[[], T]) -> T:
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._own_thread, partial(copy_context().run, question))

    def _hang_up(self) -> None:
        if self._tail is not None:
            self._tail.close()
            self._tail = None

    def _begin(self) -> EventTail:
        # not by the pool: whoever follows does not wait for slow requests
        self._tail = EventTail(self._dsn, ROLE, application="semap feed")
        return self._tail

    def _own_tail(self) -> EventTail:
        if self._tail is None:
            raise ServerUnavailable("The feed of events has no connection.")
        return self._tail

    def _new_entries(self, placed: bool) -> list[Entry]:
        # one statement and no other: all events wait for every further turn to the server
        events = self._own_tail().events(after=self.head, limit=BATCH, placed=placed)
        return [Entry.of(event) for event in events]


def _chosen(rest: Sequence[Entry], after: int, head: int, limit: int, selection: Selection) -> Page:
    entries: list[Entry] = []
    for entry in rest:
        event = entry.event if selection.own_of is None else entry.event.of_its_map()
        if selection.takes(event):
            entries.append(entry if event is entry.event else Entry.of(event))
            if len(entries) == limit:
                return Page(tuple(entries), event.seq, is_full=True)
    return Page(tuple(entries), max(after, head), is_full=False)


def _number(entry: Entry) -> int:
    return entry.event.seq


async def _notified(tail: EventTail) -> None:
    """Wait for a notification, for a second at most.

    raises  ServerUnavailable if the connection is lost
    """
    loop = asyncio.get_running_loop()
    readable = asyncio.Event()
    socket = tail.fileno()
    loop.add_reader(socket, readable.set)
    try:
        await asyncio.wait_for(readable.wait(), POLL_S)
    except TimeoutError:
        return
    finally:
        loop.remove_reader(socket)
    tail.pass_notices()
