"""Sends events to webhooks.

One deliverer works for a database at a time: whoever holds the advisory lock 7371. Another service process
tries for it every few seconds, and goes on where the last one's commits end. Each webhook has a task, which
sends one event after another and commits the outcome of each before the next: after a crash the one event
whose outcome was not committed is sent again, under the same id.

What a slow or dead receiver holds up is its own task only.
"""

from __future__ import annotations

import asyncio
import logging
import random
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TypeVar

from sqlalchemy import Connection, Engine

from semap.errors import InvalidInput, SemapError, ServerUnavailable
from semap.store.database.backoff import Reminder
from semap.store.database.connection import is_open, open_engine, own_session
from semap.store.database.event_number import newest_event
from semap.store.event.event_selection import Selection
from semap.store.event.events import StoredEvent, Stretch, read_stretch
from semap.store.event.webhook_delivery import (
    Failure,
    Letter,
    Line,
    active_webhooks,
    disable,
    give_up,
    note_delivered,
    note_failed,
    note_not_resent,
    note_resent,
    pass_over,
    read_line,
    take_turn,
)
from semap_service.context.caller import SYSTEM, acting_as
from semap_service.database.transaction import transaction
from semap_service.webhooks.message import message_id, message_of, ping
from semap_service.webhooks.retry import Retry
from semap_service.webhooks.sending import GONE, Answer, Sending
from semap_service.webhooks.signature import signed_headers

log = logging.getLogger(__name__)

T = TypeVar("T")

ROLE = "semap_admin"
PAGE = 100
WORTH_NOTING = 1000
"""So many events that were not selected move the cursor, so that a restart does not look at them again."""
THREADS = 4
LOOKUPS = 8
MOST_RETRY_S = 5.0
LONGEST_REST_S = 10.0
"""Until it is seen that a webhook was changed by way of another process."""


@dataclass(frozen=True)
class WebhookSettings:
    """How webhooks are served.

    allow_private  also addresses of private networks
    timeout_s      for an attempt, from looking up the name to the end of the answer
    look_s         how often to look for webhooks that are new or not active any more
    """

    allow_private: bool = False
    timeout_s: float = 15.0
    look_s: float = 1.0
    retry: Retry = field(default_factory=Retry)


WEBHOOKS = WebhookSettings()


class Deliverer:
    """`counts` are attempts since this process began: taken, failed, given up."""

    def __init__(
        self, dsn: str, settings: WebhookSettings, wait: Callable[[int, float], Awaitable[object]]
    ) -> None:
        self.working = False
        self.counts = {"taken": 0, "failed": 0, "given_up": 0}
        self._dsn = dsn
        self.settings = settings
        self._wait = wait
        self._engine: Engine = open_engine(dsn, ROLE, application="semap webhooks", size=THREADS)
        self._threads = ThreadPoolExecutor(THREADS, "webhooks")
        self._lookups = ThreadPoolExecutor(LOOKUPS, "webhook names")
        self._loop: asyncio.AbstractEventLoop | None = None
        self._changed = asyncio.Event()
        self._resting: dict[int, asyncio.Event] = {}
        self._turn: Connection | None = None

    def wake_soon(self) -> None:
        """Look at what was changed; called from any thread."""
        if self._loop is not None:
            with suppress(RuntimeError):  # the service has ended
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        self._changed.set()
        for each in self._resting.values():
            each.set()

    async def run(self) -> None:
        """Deliver, or wait for a turn, until cancelled."""
        self._loop = asyncio.get_running_loop()
        wait_s = self.settings.look_s
        reminder = Reminder(log, "Webhooks wait for the database")
        try:
            while True:
                try:
                    with acting_as(SYSTEM):
                        await self._take_turn()
                    wait_s = self.settings.look_s
                    reminder.over()
                except SemapError as error:
                    reminder.say(error)
                    wait_s = min(wait_s * 2, MOST_RETRY_S)
                except Exception:
                    log.exception("The delivery to webhooks failed; it begins again")
                    wait_s = min(wait_s * 2, MOST_RETRY_S)
                await asyncio.sleep(wait_s)
        finally:
            await asyncio.to_thread(self._threads.shutdown)  # else they leave connections open
            self._lookups.shutdown(wait=False, cancel_futures=True)
            self._give_turn_up()
            self._engine.dispose()

    async def ping(self, line: Line) -> tuple[str, Answer]:
        """Send a message that says nothing; the id and what came of it."""
        id_, body = ping()
        sending = self._sending()
        try:
            return id_, await self._send(sending, line, id_, body)
        finally:
            await sending.close()

    async def _take_turn(self) -> None:
        """Deliver as long as the lock is held; return at once where another has it."""
        try:
            if await self._in_thread(self._ask_turn):
                self.working = True
                await self._deliver()
        finally:
            self.working = False
            self._give_turn_up()

    def _ask_turn(self) -> bool:
        """Whether nobody else delivers. The lock is held as long as its connection lasts."""
        if self._turn is None:
            self._turn = own_session(self._dsn, ROLE, application="semap webhooks")
        return take_turn(self._turn)

    def _keep_turn(self) -> None:
        """raises  ServerUnavailable where the connection, and so the lock, is lost"""
        if self._turn is not None and not is_open(self._turn):
            raise ServerUnavailable("The connection that holds the turn to deliver was lost.")

    def _give_turn_up(self) -> None:
        if self._turn is not None:
            self._turn.close()
            self._turn = None

    async def _deliver(self) -> None:
        tasks: dict[int, asyncio.Task[None]] = {}
        try:
            while True:
                self._changed.clear()
                await self._in_thread(self._keep_turn)
                active = await self._in_database(active_webhooks)
                for id_, task in list(tasks.items()):
                    if task.done() or id_ not in active:
                        await _ended(task)
                        del tasks[id_]
                for id_ in active - tasks.keys():
                    tasks[id_] = asyncio.create_task(self._serve(id_))
                await _at_most(self._changed.wait(), self.settings.look_s)
        finally:
            for task in tasks.values():
                task.cancel()
            await asyncio.gather(*tasks.values(), return_exceptions=True)

    async def _serve(self, webhook_id: int) -> None:
        """Send to one webhook until it is not active any more."""
        sending: Sending | None = None
        url = ""
        self._resting[webhook_id] = asyncio.Event()
        try:
            while True:
                self._resting[webhook_id].clear()
                found = await self._in_database(lambda c: read_line(c, webhook_id))
                if found is None:
                    return
                line, letter = found
                if sending is None or line.url != url:
                    await _closed(sending)
                    sending, url = self._sending(), line.url
                if letter is not None:
                    await self._resend(sending, line, letter)
                elif line.due_s > 0:
                    await _at_most(self._resting[webhook_id].wait(), min(line.due_s, LONGEST_REST_S))
                else:
                    await self._send_page(sending, line)
        except InvalidInput as error:
            reason = f"its filter cannot be used: {error}"
            await self._in_database(lambda c: disable(c, webhook_id, reason))
        finally:
            del self._resting[webhook_id]
            await _closed(sending)

    async def _send_page(self, sending: Sending, line: Line) -> None:
        """Send what comes next, until one is not taken; wait where there is nothing."""
        wanted = Selection(None, line.event_type, line.rule_name, line.filter, line.maps)
        stretch = await self._in_database(lambda c: _stretch(c, line))
        cursor = line.cursor
        for event in stretch.events:
            if not wanted.takes(event):
                continue
            answer = await self._send(sending, line, message_id(event), message_of(event))
            if not await self._note(line, cursor, event, answer):
                return
            cursor = event.seq
        if stretch.last > cursor and (stretch.is_full or stretch.last - cursor >= WORTH_NOTING):
            await self._in_database(lambda c: pass_over(c, line.webhook_id, cursor, stretch.last))
        if not stretch.is_full:
            await self._news(line.webhook_id, stretch.last)

    async def _news(self, webhook_id: int, head: int) -> None:
        """Rest until there are events after a number, or the webhook was changed."""
        resting = asyncio.create_task(self._resting[webhook_id].wait())
        news = asyncio.ensure_future(self._wait(head, LONGEST_REST_S))
        try:
            await asyncio.wait({resting, news}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            resting.cancel()
            news.cancel()

    async def _note(self, line: Line, cursor: int, event: StoredEvent, answer: Answer) -> bool:
        """Commit what came of an event; whether the next one may be sent."""
        id_ = line.webhook_id
        if answer.taken:
            self.counts["taken"] += 1
            return await self._in_database(lambda c: note_delivered(c, id_, cursor, event.seq))
        if answer.status == GONE:
            reason = "the receiver answered 410: it is gone for good"
            await self._in_database(lambda c: disable(c, id_, reason))
            return False
        first = cursor == line.cursor
        tried = line.attempts + 1 if first else 1
        given_up_in_row = line.given_up_in_row if first else 0
        wait_s = self.settings.retry.wait_s(tried, given_up_in_row, answer.asked_s, random.random())  # noqa: S311
        failure = Failure(
            event.seq,
            event.event_id,
            event.map,
            event.type,
            message_of(event),
            tried,
            answer.error,
            answer.status,
        )
        self.counts["failed"] += 1
        if wait_s is None:
            self.counts["given_up"] += 1
            await self._in_database(lambda c: give_up(c, id_, cursor, failure))
        else:
            await self._in_database(lambda c: note_failed(c, id_, cursor, failure, wait_s))
        return False

    async def _resend(self, sending: Sending, line: Line, letter: Letter) -> None:
        answer = await self._send(sending, line, str(letter.event_id), letter.body)
        if answer.taken:
            self.counts["taken"] += 1
            await self._in_database(lambda c: note_resent(c, line.webhook_id, letter.dead_letter_id))
        else:
            self.counts["failed"] += 1
            await self._in_database(
                lambda c: note_not_resent(c, line.webhook_id, answer.error, answer.status)
            )

    async def _send(self, sending: Sending, line: Line, id_: str, text: str) -> Answer:
        body = text.encode()
        return await sending.post(line.url, signed_headers(id_, int(time.time()), body, line.keys), body)

    def _sending(self) -> Sending:
        return Sending(
            self._lookups, allow_private=self.settings.allow_private, timeout_s=self.settings.timeout_s
        )

    async def _in_database(self, work: Callable[[Connection], T]) -> T:
        def run() -> T:
            with acting_as(SYSTEM), transaction(self._engine) as connection:
                return work(connection)

        return await self._in_thread(run)

    async def _in_thread(self, work: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._threads, work)


def _stretch(connection: Connection, line: Line) -> Stretch:
    """The next events, chosen as far as the database can; `last` is also past those that nobody chose."""
    newest = newest_event(connection)
    found = read_stretch(
        connection,
        after=line.cursor,
        limit=PAGE,
        map_name=next(iter(line.maps)) if line.maps is not None and len(line.maps) == 1 else None,
        event_type=line.event_type,
        rule_name=line.rule_name,
    )
    return found if found.is_full else replace(found, last=max(found.last, newest))


async def _closed(sending: Sending | None) -> None:
    if sending is not None:
        await sending.close()


async def _ended(task: asyncio.Task[None]) -> None:
    """End a task, and say why it had ended by itself."""
    task.cancel()
    await asyncio.wait({task})
    if task.cancelled():
        return
    error = task.exception()
    if isinstance(error, SemapError):
        log.warning("A webhook waits for the database: %s", error)
    elif error is not None:
        log.error("The delivery to a webhook failed; it begins again", exc_info=error)


async def _at_most(waiting: Awaitable[object], timeout_s: float) -> None:
    with suppress(TimeoutError):
        await asyncio.wait_for(waiting, timeout_s)
