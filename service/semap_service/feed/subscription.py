"""One client that follows: hello, what it missed, what happens, and heartbeats in between.

What has happened while the client took the last message is one message, so that messages are few where
events are many. A client is at its own pace, but for two limits: what it is sent it takes within
`patience_s`, and once it has come up with what happens, it is not further behind than `most_behind` for
longer than that. One that is gets told so, with the cursor to go on at, and is closed.
"""

from __future__ import annotations

import asyncio

from semap.errors import InvalidInput
from semap_service.documents.feed import Hello, TooSlow
from semap_service.feed.channel import Channel
from semap_service.feed.ring import Feed
from semap_service.feed.start_position import StartPosition
from semap_service.http.outlet import NotTaken, Outlet, Pace


async def follow(feed: Feed, channel: Channel, outlet: Outlet, beginning: StartPosition, pace: Pace) -> None:
    """Send a client all that its channel gives, until the task is cancelled or the client is too slow.

    raises  ServerUnavailable if the past is needed and the database does not answer
            InvalidInput where the database was exchanged for an older one
    """
    subscription = _Subscription(feed, channel, outlet, beginning, pace)
    try:
        await subscription.run()
    except NotTaken:
        await subscription.give_up(f"What was sent was not taken within {pace.patience_s:g} s.")
    except _FellBehind as error:
        await subscription.give_up(str(error))


class _FellBehind(Exception):
    pass


class _Subscription:
    def __init__(
        self, feed: Feed, channel: Channel, outlet: Outlet, beginning: StartPosition, pace: Pace
    ) -> None:
        self.cursor = beginning.cursor
        self._feed = feed
        self._channel = channel
        self._outlet = outlet
        self._beginning = beginning
        self._pace = pace
        self._now_s = asyncio.get_running_loop().time
        self._sent_s = self._now_s()
        self._level_s: float | None = None
        self._followed = feed.beginnings

    async def run(self) -> None:
        if self._head < self._beginning.head:
            # The ring is about to hear of what the database has.
            batch = await self._channel.stored_after(self.cursor)
        else:
            batch = await self._channel.after(self.cursor)
        missed = batch.written is not None or batch.is_full
        hello = Hello(
            cursor=self.cursor,
            head=self._beginning.head,
            oldest=self._beginning.oldest,
            resumed="no_longer_kept" if self._beginning.gap else "replayed" if missed else "nothing_missed",
        )
        await self._put(self._channel.encoding.hello(hello))
        while True:
            self._require_same()
            if batch.written is not None:
                await self._put(batch.written)
                self._feed.sent += batch.count
            self.cursor = batch.cursor
            if batch.is_full:
                self._require_near()
                await self._beat()
                await asyncio.sleep(0)
            else:
                await self._come_level()
            await self._outlet.ready(self._pace.patience_s)
            batch = await self._channel.after(self.cursor)

    @property
    def _head(self) -> int:
        return self._feed.head_of(self._channel.selection)

    async def give_up(self, why: str) -> None:
        """Tell the client that it is too slow."""
        self._feed.too_slow += 1
        self._outlet.let_pass()
        message = TooSlow(cursor=self.cursor, detail=why)
        await self._outlet.put(self._channel.encoding.message(message), self._pace.patience_s)

    async def _come_level(self) -> None:
        """Wait for what is after the cursor."""
        while self._head <= self.cursor:
            await self._beat()
            await self._feed.news()
            self._require_same()
        self._level_s = self._now_s()

    async def _beat(self) -> None:
        if self._now_s() - self._sent_s >= self._pace.heartbeat_s:
            await self._put(self._channel.encoding.heartbeat(self.cursor))

    def _require_near(self) -> None:
        behind = self._head - self.cursor
        if (
            self._level_s is not None
            and behind > self._pace.most_behind
            and self._now_s() - self._level_s > self._pace.patience_s
        ):
            raise _FellBehind(f"It is {behind:,} events behind; {self._pace.most_behind:,} are allowed.")

    def _require_same(self) -> None:
        if self._followed == 0:
            self._followed = self._feed.beginnings
        if self._feed.beginnings != self._followed:
            raise InvalidInput(
                "The database was exchanged for one with other events.", "Begin again without a cursor."
            )

    async def _put(self, written: bytes) -> None:
        await self._outlet.ready(self._pace.patience_s)
        await self._outlet.put(written, self._pace.patience_s)
        self._sent_s = self._now_s()
