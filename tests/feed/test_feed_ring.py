"""What the ring keeps is bounded, in events and in bytes, and what it gives has no gap."""

import asyncio

from hypothesis import given
from hypothesis import strategies as st
from semap_service.feed.channel import Channels
from semap_service.feed.encoding import Envelope, SocketEncoding
from semap_service.feed.ring import Entry, Feed
from sqlalchemy import create_engine
from stored import stored

from semap.store.event.event_selection import Selection

OFFICE = Selection(map="office")


def entry(seq: int, size: int = 10) -> Entry:
    event = stored(seq, map="office" if seq % 2 else "home")
    return Entry(event, b"x" * size)


async def filled(batches: list[list[int]], **bounds: int) -> Feed:
    feed = Feed(create_engine("postgresql+psycopg://"), "", **bounds)
    feed._floor = 0
    seq = 0
    for batch in batches:
        feed._append([entry(seq := seq + 1, size) for size in batch])
    return feed


@given(
    st.lists(st.lists(st.integers(1, 60), min_size=1, max_size=8), min_size=1, max_size=12),
    st.integers(1, 10),
    st.integers(20, 200),
)
def test_it_keeps_the_newest_within_its_bounds(batches: list[list[int]], size: int, most_bytes: int) -> None:
    async def play() -> None:
        feed = await filled(batches, ring_size=size, ring_bytes=most_bytes)
        sizes = [each for batch in batches for each in batch]
        kept = [each.event.seq for each in feed._ring]
        assert kept == list(range(len(sizes) - len(kept) + 1, len(sizes) + 1))
        assert feed.head == len(sizes)
        assert feed._floor == len(sizes) - len(kept)
        assert len(kept) <= size
        assert feed._bytes == sum(sizes[-len(kept) :])
        assert feed._bytes <= most_bytes or len(kept) == 1
        if len(kept) < min(size, len(sizes)):
            # it was full at some time: one more would not always have fitted
            assert feed._floor > 0
        for after in range(len(sizes) + 2):
            page = feed.known(after, 1000, Selection())
            if after < feed._floor:
                assert page is None
            else:
                assert [each.seq for each in page.events] == list(range(after + 1, len(sizes) + 1))

    asyncio.run(play())


def test_all_of_one_selection_are_sent_the_same_bytes() -> None:
    async def play() -> None:
        feed = await filled([[10] * 6])
        channels = Channels(feed)
        encoding = SocketEncoding(Envelope())
        with channels.following(OFFICE, encoding) as one, channels.following(OFFICE, encoding) as two:
            assert one is two
            first, second = await one.after(0), await two.after(0)
            assert first.written is second.written
            assert (first.cursor, first.count, first.is_full) == (6, 3, False)
            with channels.following(Selection(), encoding) as other:
                assert (await other.after(0)).count == 6
            feed._append([entry(seq, 70_000) for seq in range(7, 13)])
            batch = await one.after(6)
            assert (batch.cursor, batch.count, batch.is_full) == (7, 1, True)
            batches = [await one.after(cursor) for cursor in (7, 9, 11)]
            assert [(each.cursor, each.count) for each in batches] == [(9, 1), (12, 1), (12, 0)]
            assert len(one._kept) <= 2
        assert channels._open == {}

    asyncio.run(play())
