"""From the events of a map, or the changes of its relations, to a sink: in order, from its cursor on."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from typing import Protocol

import psycopg
from sqlalchemy import Connection

from semap.errors import ServerUnavailable
from semap.store.database.connection import listen, own_session, wait_for_notice
from semap.store.database.event_number import newest_event
from semap.store.event.event_selection import Selection
from semap.store.event.events import StoredEvent, read_stretch
from semap.store.motion.bridges import Place, Position, move_position, read_position
from semap.store.motion.live import LiveMap, live_map
from semap.store.relation.changes import ChangeReader, StoredChange, newest_change
from semap_bridge.adapter import Display, Happening, Sink
from semap_bridge.context import ROLE, Context
from semap_bridge.given_out import takes_change
from semap_bridge.pausing import Pause

NAME = "semap bridge"
PAGE = 500
POLL_S = 0.5
"""Changes of relations are not notified."""
WORTH_NOTING = 1000
"""So many events of other maps move the cursor, so that a restart does not look at them again."""


class Reader(Protocol):
    """Reads what is given out, in the order of its numbers."""

    def read(
        self, connection: Connection, after: int, limit: int
    ) -> tuple[Sequence[StoredEvent | StoredChange], int, bool]:
        """What is after a number, up to which all was looked at then, and whether there are more already."""


@dataclass(frozen=True)
class EventReader:
    """Reads the events of a map that fit a filter (CQL2; None: all)."""

    map_name: str
    filter: str | None = None

    def read(self, connection: Connection, after: int, limit: int) -> tuple[Sequence[StoredEvent], int, bool]:
        newest = newest_event(connection)
        found = read_stretch(connection, after=after, limit=limit, map_name=self.map_name)
        wanted = Selection(filter=self.filter)
        events = [each for each in found.events if wanted.takes(each)]
        return events, found.last if found.is_full else max(found.last, newest), found.is_full


@dataclass(frozen=True)
class FilteredChanges:
    """Reads the changes of relations that fit a filter (CQL2; None: all)."""

    changes: ChangeReader
    filter: str | None = None

    def read(
        self, connection: Connection, after: int, limit: int
    ) -> tuple[Sequence[StoredChange], int, bool]:
        found, last, is_full = self.changes.read(connection, after, limit)
        return [each for each in found if takes_change(self.filter, each)], last, is_full


@dataclass(frozen=True)
class Past:
    """What had happened when bridges were started: the numbers of the newest event and change of a relation.

    A new bridge gives out what is after them, however long its peer keeps it waiting: so also what its own
    records make happen, or those of a bridge that was started with it.
    """

    event: int = 0
    change: int = 0

    @staticmethod
    def now(connection: Connection) -> Past:
        """As it is now."""
        return Past(newest_event(connection), newest_change(connection))


class Delivery:
    """Mutable: up to which number all was given out."""

    def __init__(self, context: Context, dsn: str, place: Place, reader: Reader, first: int) -> None:
        """first: all after this number is given out by a bridge that has no cursor yet"""
        self._context = context
        self._dsn = dsn
        self._place = place
        self._reader = reader
        self._first = first
        self._noted: Position | None = None

    async def noted(self) -> int:
        """The cursor in the database, noted the first time."""
        self._noted = await self._context.ask(lambda c: read_position(c, self._place))
        if self._noted is not None:
            return int(str(self._noted["event"]))
        return await self._note(self._first)

    async def give(self, sink: Sink) -> None:
        """Give out what happens, until cancelled.

        raises  Conflict where somebody else moved the cursor
        """
        pause = Pause(self._context, "the database")
        cursor: int | None = None
        while True:
            try:
                with _listening(self._dsn) as hear:
                    if cursor is None:
                        cursor = await self._begin(sink)
                    pause.over()
                    while True:
                        cursor, is_full = await self._give_page(sink, cursor)
                        if not is_full:
                            await self._context.in_thread(hear)
            except ServerUnavailable as error:
                await pause.after(error)

    async def _begin(self, sink: Sink) -> int:
        if sink.cursor_at == "broker" and (cursor := await sink.cursor()) is not None:
            return cursor
        return await self.noted()

    async def _note(self, cursor: int) -> int:
        was, now = self._noted, {"event": cursor}

        def move(connection: Connection) -> None:
            if read_position(connection, self._place) != now:  # else its answer was lost
                move_position(connection, self._place, was, now)

        await self._context.ask(move)
        self._noted = now
        return cursor

    async def _give_page(self, sink: Sink, cursor: int) -> tuple[int, bool]:
        made, last, is_full = await self._context.ask(lambda c: self._reader.read(c, cursor, PAGE))
        if made:
            figures = self._context.figures
            figures.lag_s = _age_s(made[0])
            await sink.deliver([Happening(each.seq, each) for each in made])
            figures.delivered += len(made)
            figures.lag_s = _age_s(made[0])
        if sink.cursor_at == "database" and (
            made or last - int(str((self._noted or {})["event"])) >= WORTH_NOTING
        ):
            await self._note(last)
        return last, is_full


async def show(context: Context, dsn: str, map_id: int, display: Display) -> None:
    """Show a display the present every so often, until cancelled.

    By a session of its own, without transactions: one that is of a pool costs as much again as the question.
    """
    pause = Pause(context, "the database")
    loop = asyncio.get_running_loop()
    due_s = loop.time()
    session: Connection | None = None

    def look() -> LiveMap | None:
        nonlocal session
        session = session or own_session(dsn, ROLE, application=NAME)
        return live_map(session, map_id)

    try:
        while True:
            try:
                present = await context.in_thread_to_its_end(look)
                pause.over()
            except ServerUnavailable as error:
                _close(session)
                session = None
                await pause.after(error)
                continue
            if present is not None:
                await display.show(present)
            due_s = max(due_s + display.every_s, loop.time())
            await asyncio.sleep(due_s - loop.time())
    finally:
        _close(session)


def _close(session: Connection | None) -> None:
    if session is not None:
        session.close()


def _age_s(made: StoredEvent | StoredChange) -> float:
    return max(0.0, (datetime.now(UTC) - made.created_at).total_seconds())


@contextmanager
def _listening(dsn: str) -> Iterator[Hear]:
    listener: psycopg.Connection = listen(dsn, "semap_event", ROLE, application=NAME)
    try:
        yield partial(wait_for_notice, listener, POLL_S)
    finally:
        listener.close()


Hear = partial[bool]
