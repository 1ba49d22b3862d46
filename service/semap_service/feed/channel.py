"""What all who want the same are sent: chosen, and written, once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeAlias

from semap.store.event.event_selection import Selection
from semap_service.feed.encoding import SocketEncoding, StreamEncoding
from semap_service.feed.ring import Feed, Page

BATCH_EVENTS = 500
BATCH_BYTES = 128 * 1024
BATCHES_KEPT = 2

Encoding: TypeAlias = SocketEncoding | StreamEncoding


@dataclass(frozen=True, slots=True)
class Batch:
    """All that was selected after one cursor and up to another, written; None where there was nothing."""

    written: bytes | None
    cursor: int
    count: int
    is_full: bool


class Channel:
    """The batches of one selection in one encoding; the last ones are kept for others at that place."""

    def __init__(self, feed: Feed, selection: Selection, encoding: Encoding) -> None:
        self.encoding = encoding
        self.selection = selection
        self._feed = feed
        self._kept: dict[int, Batch] = {}

    async def after(self, cursor: int) -> Batch:
        """The batch after a cursor.

        raises  ServerUnavailable if the database is needed and does not answer
        """
        batch = self._kept.get(cursor)
        if batch is not None:
            return batch
        page = await self._feed.look(cursor, BATCH_EVENTS, self.selection)
        if page is None:
            return await self.stored_after(cursor)
        batch = self._written(page.of_at_most(BATCH_BYTES))
        if batch.cursor > cursor:
            self._kept[cursor] = batch
            if len(self._kept) > BATCHES_KEPT:
                del self._kept[next(iter(self._kept))]
        return batch

    async def stored_after(self, cursor: int) -> Batch:
        """The same from the database; not kept, since those who catch up are each at a place of their own."""
        page = await self._feed.read_past(cursor, BATCH_EVENTS, self.selection)
        return self._written(page.of_at_most(BATCH_BYTES))

    def _written(self, page: Page) -> Batch:
        written = self.encoding.events(page.entries, page.cursor) if page.entries else None
        return Batch(written, page.cursor, len(page.entries), page.is_full)


@dataclass
class Channels:
    """Those that somebody follows."""

    feed: Feed
    _open: dict[tuple[Selection, Encoding, int], tuple[Channel, int]] = field(default_factory=dict)

    @contextmanager
    def following(self, selection: Selection, encoding: Encoding) -> Iterator[Channel]:
        """The channel of a selection, for as long as it is followed."""
        key = (selection, encoding, self.feed.beginnings)
        channel, followers = self._open.get(key) or (Channel(self.feed, selection, encoding), 0)
        self._open[key] = (channel, followers + 1)
        try:
            with self.feed.placing(selection):
                yield channel
        finally:
            channel, followers = self._open.pop(key)
            if followers > 1:
                self._open[key] = (channel, followers - 1)
