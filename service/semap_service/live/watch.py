"""One look at a map for all who watch it, as often as it is worth it, and only while somebody does."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import TypeVar

from sqlalchemy import Engine

from semap.errors import NotFound, SemapError
from semap.store.database.backoff import Reminder
from semap.store.motion.live import LiveMap, live_map
from semap_service.context.caller import SYSTEM, acting_as
from semap_service.database.transaction import transaction
from semap_service.documents.live_map import LiveHeartbeat
from semap_service.http.outlet import Outlet, Pace
from semap_service.http.websocket import text_frame
from semap_service.live.picture import Picture, delta, picture_of, snapshot

log = logging.getLogger(__name__)

LOOK_S = 0.05
IDLE_LOOK_S = 0.2
IDLE_AFTER = 20
"""So many looks that show nothing new, and it is looked less often."""
RETRY_S = 1.0

T = TypeVar("T")

HEARTBEAT = text_frame(LiveHeartbeat().model_dump_json().encode())


class Watch:
    """The newest picture of a map.

    `closed` says why there will be none any more.
    """

    def __init__(self, engine: Engine, map_id: int, name: str) -> None:
        self.picture: Picture | None = None
        self.closed: SemapError | None = None
        self._engine = engine
        self._map_id = map_id
        self._name = name
        self._news = asyncio.Event()
        self._last_delta: tuple[Picture, Picture, bytes] | None = None

    async def run(self) -> None:
        """Look until the map is gone, or the task is cancelled."""
        unchanged = 0
        reminder = Reminder(log, f"The live map {self._name} waits for the database")
        while self.closed is None:
            try:
                live = await _to_the_end(self._look)
            except SemapError as error:
                reminder.say(error)
                await asyncio.sleep(RETRY_S)
                continue
            except Exception:
                log.exception("The live map %s failed; it is looked at again", self._name)
                await asyncio.sleep(RETRY_S)
                continue
            reminder.over()
            if live is None:
                self.closed = NotFound("map", self._name, "List the maps to see their names.")
                self._wake()
                return
            picture = picture_of(live, self.picture)
            if self.picture is not None and picture.shows_the_same(self.picture):
                unchanged += 1
            else:
                unchanged = 0
                self.picture = picture
                self._wake()
            await asyncio.sleep(LOOK_S if unchanged < IDLE_AFTER else IDLE_LOOK_S)

    async def newer(self, than: Picture | None, timeout_s: float) -> Picture | None:
        """The newest picture as soon as it is another one than this; None if that takes too long.

        raises  NotFound when the map is gone
        """
        with suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while self.picture is than and self.closed is None:
                    await self._news.wait()
        if self.closed is not None:
            raise self.closed
        return None if self.picture is than else self.picture

    def frame(self, before: Picture | None, now: Picture, *, own: bool) -> bytes:
        """What leads from one picture to another; most have the same one before, and share it."""
        if before is None:
            return text_frame(snapshot(now, own=own))
        known = self._last_delta
        if known is None or known[0] is not before or known[1] is not now:
            known = self._last_delta = (before, now, text_frame(delta(before, now)))
        return known[2]

    def _look(self) -> LiveMap | None:
        with transaction(self._engine) as connection:
            return live_map(connection, self._map_id)

    def _wake(self) -> None:
        news, self._news = self._news, asyncio.Event()
        news.set()


async def _to_the_end(question: Callable[[], T]) -> T:
    """Ask in a thread; who is cancelled waits for it, so that its connection is given back in time."""
    asking = asyncio.ensure_future(asyncio.to_thread(question))
    try:
        return await asyncio.shield(asking)
    except asyncio.CancelledError:
        with suppress(SemapError):
            await asking
        raise


@dataclass
class Watches:
    """The maps that somebody watches."""

    _open: dict[int, tuple[Watch, asyncio.Task[None], int]] = field(default_factory=dict)

    @asynccontextmanager
    async def watching(self, engine: Engine, map_id: int, name: str) -> AsyncIterator[Watch]:
        """The watch of a map, for as long as it is needed."""
        if map_id not in self._open:
            made = Watch(engine, map_id, name)
            with acting_as(SYSTEM, "read"):
                self._open[map_id] = (made, asyncio.create_task(made.run()), 0)
        watch, task, watchers = self._open[map_id]
        self._open[map_id] = (watch, task, watchers + 1)
        try:
            yield watch
        finally:
            watch, task, watchers = self._open.pop(map_id)
            if watchers > 1:
                self._open[map_id] = (watch, task, watchers - 1)
            else:
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task


async def show(watch: Watch, outlet: Outlet, pace: Pace, *, own: bool) -> None:
    """Send a client a snapshot and then deltas, the newest whenever it has taken the one before.

    raises  NotTaken, and NotFound when the map is gone
    """
    shown: Picture | None = None
    while True:
        await outlet.ready(pace.patience_s)
        now = await watch.newer(shown, pace.heartbeat_s)
        if now is None:
            await outlet.put(HEARTBEAT, pace.patience_s)
            continue
        await outlet.put(watch.frame(shown, now, own=own), pace.patience_s)
        shown = now
