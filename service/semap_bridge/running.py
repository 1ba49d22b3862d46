"""Runs one bridge: holds its name, waits for its peer and the database, and says how it does."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from threading import Event as Signal
from typing import Any

from semap_ingest.state_intake import StateIntake
from sqlalchemy import Connection

from semap.errors import Conflict, NotFound, SemapError, ServerUnavailable, ServiceUnreachable
from semap.store.database.connection import open_engine, own_session
from semap.store.motion.bridges import Place, Way, hold_bridge, tell_bridge
from semap.store.motion.live import live_map
from semap.store.relation.changes import ChangeReader
from semap_bridge.adapter import Adapter
from semap_bridge.config import Entry
from semap_bridge.context import ROLE, Context
from semap_bridge.delivery import Delivery, EventReader, FilteredChanges, Past, Reader, show
from semap_bridge.intake import Intake
from semap_bridge.pausing import Pause

log = logging.getLogger(__name__)

THREADS = 4
TELL_S = 2.0
HOLD_TRIES = 50
HOLD_RETRY_S = 0.1
"""The server may take a while to see that a process is gone and to let go of its lock."""
STOP_S = 5.0


def run_bridge(dsn: str, entry: Entry, stop: Signal, past: Past | None = None) -> None:
    """Run a bridge until it is told to stop, or all that it reads is in.

    past    what a new bridge does not give out; None: what has happened by now
    raises  Conflict where another process runs it; SemapError for what waiting does not mend
    """
    asyncio.run(_until_told(_Running(dsn, entry, past).run(), stop))


def open_context(dsn: str, entry: Entry) -> Context:
    settings = entry.settings
    return Context(
        map_name=entry.map_name,
        name=settings.name,
        source=settings.source or settings.name,
        engine=open_engine(dsn, ROLE, application="semap bridge", size=THREADS),
        threads=ThreadPoolExecutor(THREADS, "bridge"),
    )


def close_context(context: Context) -> None:
    context.threads.shutdown(wait=True)
    context.engine.dispose()


async def _until_told(work: Coroutine[Any, Any, None], stop: Signal) -> None:
    task = asyncio.create_task(work)
    told = asyncio.create_task(asyncio.to_thread(stop.wait))
    try:
        await asyncio.wait({task, told}, return_when=asyncio.FIRST_COMPLETED)
        if not task.done():
            task.cancel()
        with suppress(asyncio.CancelledError):
            await task
    finally:
        stop.set()
        await told


class _Running:
    def __init__(self, dsn: str, entry: Entry, past: Past | None) -> None:
        self._dsn = dsn
        self._entry = entry
        self._past = Past() if entry.settings.from_start else past
        self._context = open_context(dsn, entry)
        self._held: Connection | None = None

    async def run(self) -> None:
        pause = Pause(self._context, "its map")
        try:
            while True:
                try:
                    self._past = self._past or await self._context.ask(Past.now)
                    states = await self._context.ask(
                        lambda c: StateIntake(c, self._entry.map_name, self._entry.settings.concept)
                    )
                    await self._hold(states.map_id)
                    pause.over()
                    log.info("%s: runs on map %s", self._context.name, self._entry.map_name)
                    await self._on_map(states)
                    return
                except (ServerUnavailable, NotFound) as error:
                    await pause.after(error)
                except Conflict as error:
                    if await self._is_map_there(states.map_id):
                        raise
                    await pause.after(error)
        finally:
            if self._held is not None:
                self._held.close()
            close_context(self._context)

    async def _on_map(self, states: StateIntake) -> None:
        self._context.figures.ended = False
        intake = Intake(self._context, self._entry.settings, states)
        writer = asyncio.create_task(intake.write())
        keeper = asyncio.create_task(self._keep(states.map_id))
        sessions = asyncio.create_task(self._sessions(intake, states.map_id))
        try:
            await _first_of(sessions, writer, keeper)
            await _first_of(asyncio.create_task(intake.drained()), writer, keeper)
        except asyncio.CancelledError:
            await _cancelled(sessions)
            with suppress(TimeoutError, SemapError):
                async with asyncio.timeout(STOP_S):
                    await _first_of(asyncio.create_task(intake.drained()), writer)
            raise
        finally:
            for each in (sessions, writer, keeper):
                await _cancelled(each)
            self._context.figures.ended = True
            with suppress(SemapError):
                await self._tell(states.map_id)

    async def _is_map_there(self, map_id: int) -> bool:
        return await self._context.ask(lambda c: live_map(c, map_id)) is not None

    async def _hold(self, map_id: int) -> None:
        """Keep others from the bridge; raises Conflict where another process has it."""
        if self._held is not None:
            self._held.close()
            self._held = None
        held = await self._context.in_thread(lambda: own_session(self._dsn, ROLE, application="semap bridge"))
        self._held = held
        for _ in range(HOLD_TRIES):
            if await self._context.in_thread(lambda: hold_bridge(held, map_id, self._context.name)):
                return
            await asyncio.sleep(HOLD_RETRY_S)
        raise Conflict(
            f"Another process runs the bridge {self._context.name} of the map {self._entry.map_name}.",
            "Stop it, or give this one a name of its own.",
        )

    async def _keep(self, map_id: int) -> None:
        """Say how the bridge does, and hold it again where the connection was lost."""
        pause = Pause(self._context, "the database")
        while True:
            try:
                await self._tell(map_id)
                pause.over()
                await asyncio.sleep(TELL_S)
            except ServerUnavailable as error:
                await pause.after(error)
                with suppress(ServerUnavailable):
                    await self._hold(map_id)

    async def _tell(self, map_id: int) -> None:
        report = self._context.figures.report(self._entry.settings.kind)

        def tell() -> None:
            if self._held is None:
                raise ServerUnavailable("The connection to the database is lost.")
            tell_bridge(self._held, map_id, self._context.name, report)

        await self._context.in_thread(tell)

    async def _sessions(self, intake: Intake, map_id: int) -> None:
        """One connection to the peer after another, until all that there is to read is read."""
        pause = Pause(self._context, "its peer")
        map_name, past, settings = self._entry.map_name, self._past or Past(), self._entry.settings
        ways: tuple[tuple[Way, Reader, int], ...] = (
            ("out", EventReader(map_name, settings.filter), past.event),
            ("changes", FilteredChanges(ChangeReader(map_name), settings.changes_filter), past.change),
        )
        events, changes = (
            Delivery(self._context, self._dsn, Place(map_id, self._context.name, way), reader, first)
            for way, reader, first in ways
        )
        fault = ""
        while True:
            adapter = self._entry.adapter(self._context)
            try:
                try:
                    await adapter.open()
                    pause.over()
                    await self._play(adapter, intake, events, changes)
                    return
                finally:
                    await adapter.close()
            except (ServiceUnreachable, ServerUnavailable, OSError) as error:
                self._context.figures.reconnects += 1
                await pause.after(error)
            except SemapError:
                raise
            except Exception as error:
                if repr(error) != fault:
                    log.exception("%s: a fault of the adapter; it begins again", self._context.name)
                fault = repr(error)
                self._context.figures.reconnects += 1
                await pause.after(error)

    async def _play(self, adapter: Adapter[Any], intake: Intake, events: Delivery, changes: Delivery) -> None:
        source, display = adapter.source(), adapter.display()
        sinks = [(events, adapter.sink()), (changes, adapter.changes())]
        given = [(delivery, sink) for delivery, sink in sinks if sink is not None]
        for delivery, _ in given:
            await delivery.noted()
        roles: list[Coroutine[Any, Any, None]] = [delivery.give(sink) for delivery, sink in given]
        if source is not None:
            roles.append(intake.read(source))
        if display is not None:
            roles.append(show(self._context, self._dsn, intake.map_id, display))
        tasks = [asyncio.create_task(each) for each in roles]
        try:
            while tasks:
                done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
                for each in done:
                    tasks.remove(each)
                    each.result()
        finally:
            for each in tasks:
                await _cancelled(each)


async def _first_of(main: asyncio.Task[None], *others: asyncio.Task[None]) -> None:
    """Wait until the first is done; raise what one of the others raises before."""
    done, _ = await asyncio.wait({main, *others}, return_when=asyncio.FIRST_COMPLETED)
    for each in done:
        each.result()


async def _cancelled(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.wait({task})
    if not task.cancelled():
        task.exception()
