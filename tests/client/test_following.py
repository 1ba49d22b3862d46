"""Following the feed: whatever breaks, each event comes once and in order."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from itertools import islice

import httpx
import pytest
from answering import Script, client_of, problem
from hypothesis import given
from hypothesis import strategies as st

from semap import AsyncClient
from semap.client import awaiting, blocking
from semap.errors import (
    AccessRefused,
    InvalidInput,
    NoLongerKept,
    ServiceUnreachable,
    UntrustedBytes,
)

EVENT = {
    "event_id": "0f8e2f6e-4b0b-5c0f-9a3e-0d1b5c1c7d11", "type": "entered", "stamp": "2026-01-31T12:00:04Z",
    "since": "2026-01-31T12:00:04Z", "track": {"id": 3, "name": "ann"}, "instance": None, "key": {},
    "measures": {}, "confidence": None, "evidence": [], "map": "home", "rule": "visits", "rule_version": 1,
    "cause": None, "by_batch": False, "verdict": None, "amended_by": None,
}  # fmt: skip


@pytest.fixture(autouse=True)
def slept(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    pauses: list[float] = []

    async def awaited(seconds: float) -> None:
        pauses.append(seconds)

    monkeypatch.setattr(blocking.time, "sleep", pauses.append)
    monkeypatch.setattr(awaiting.asyncio, "sleep", awaited)
    return pauses


def message(seq: int) -> bytes:
    return f"id: {seq}\ndata: {json.dumps({**EVENT, 'seq': seq})}\n\n".encode()


def hello(cursor: int, **more: object) -> bytes:
    said = {"type": "hello", "cursor": cursor, "resumed": "replayed", **more}
    return f"retry: 1000\n\nevent: hello\nid: {cursor}\ndata: {json.dumps(said)}\n\n".encode()


class Broken(httpx.SyncByteStream, httpx.AsyncByteStream):
    """Pieces of a stream, after which the connection breaks, or ends."""

    def __init__(self, pieces: list[bytes], breaks: bool) -> None:
        self.pieces = pieces
        self.breaks = breaks

    def __iter__(self) -> Iterator[bytes]:
        yield from self.pieces
        if self.breaks:
            raise httpx.ReadError("the connection broke")

    async def __aiter__(self):
        for piece in self:
            yield piece


class FeedOf:
    """A log of events behind connections each of which gives so many bytes in so large pieces."""

    def __init__(self, log: list[int], cuts: list[tuple[int, int, bool]]) -> None:
        self.log = log
        self.cuts = iter(cuts)
        self.asked: list[str | None] = []

    def __call__(self, request: httpx.Request) -> httpx.Response:
        after = request.url.params.get("after")
        self.asked.append(after)
        cursor = int(after or 0)
        # a proxy may send again what it holds: the last event before the cursor comes once more
        again = [seq for seq in self.log if seq <= cursor][-1:]
        heartbeat = f": alive\nid: {self.log[-1] if self.log else cursor}\n\n".encode()
        whole = (
            hello(cursor)
            + b"".join(message(seq) for seq in [*again, *[s for s in self.log if s > cursor]])
            + heartbeat
        )
        end, size, breaks = next(self.cuts, (len(whole), len(whole), True))
        shown = whole[: min(end, len(whole))]
        pieces = [shown[first : first + size] for first in range(0, len(shown), size)]
        return httpx.Response(
            200, headers={"content-type": "text/event-stream"}, stream=Broken(pieces, breaks)
        )


logs = st.lists(st.integers(1, 10_000), min_size=1, max_size=12, unique=True).map(sorted)
cuts = st.lists(st.tuples(st.integers(0, 8000), st.integers(1, 3000), st.booleans()), max_size=8)


@given(logs, cuts)
def test_each_event_comes_once_and_in_order_however_connections_break(
    log: list[int], cut: list[tuple[int, int, bool]]
) -> None:
    with client_of(FeedOf(log, cut), retries=10) as client:
        followed = client.events("home", follow=True, after=0)
        assert [event.seq for event in islice(followed, len(log))] == log


@given(logs, cuts)
def test_awaiting_does_the_same(log: list[int], cut: list[tuple[int, int, bool]]) -> None:
    async def follow() -> list[int]:
        found: list[int] = []
        transport = httpx.MockTransport(FeedOf(log, cut))
        async with AsyncClient("http://semap.test", transport=transport, retries=10) as client:
            async for event in client.events(follow=True, after=0):
                found.append(event.seq)
                if len(found) == len(log):
                    return found
        return found

    assert asyncio.run(follow()) == log


def test_what_is_asked_for_again_begins_after_the_last_event() -> None:
    feed = FeedOf([5, 9, 12], [(0, 1, True), (len(hello(0)) + len(message(5)), 100, True)])
    events = client_of(feed).events("home", follow=True, type="entered", filter="track = 'ann'")
    assert [each.seq for each in islice(events, 3)] == [5, 9, 12]
    assert feed.asked == [None, None, "5"]


def test_without_a_cursor_it_goes_on_from_where_the_stream_began() -> None:
    streams = [hello(40), hello(40) + message(41)]
    script = Script(
        [httpx.Response(200, headers={"content-type": "text/event-stream"}, content=each) for each in streams]
    )
    assert next(client_of(script).events(follow=True)).seq == 41
    assert [request.url.params.get("after") for request in script.asked] == [None, "40"]


def test_events_that_are_gone_are_told_or_skipped_as_asked() -> None:
    stream = hello(99, resumed="no_longer_kept", oldest=100) + message(100)
    reply = httpx.Response(200, headers={"content-type": "text/event-stream"}, content=stream)
    with pytest.raises(NoLongerKept, match="100") as raised:
        next(client_of(Script([reply])).events(follow=True, after=7))
    assert (raised.value.after, raised.value.oldest) == (7, 100)
    assert next(client_of(Script([reply])).events(follow=True, after=7, gaps="skip")).seq == 100


def test_a_refusal_is_raised_and_a_busy_service_awaited(slept: list[float]) -> None:
    with pytest.raises(AccessRefused):
        next(client_of(Script([problem(401)])).events(follow=True))
    with pytest.raises(InvalidInput):
        next(client_of(Script([problem(422)])).events(follow=True))
    good = httpx.Response(200, headers={"content-type": "text/event-stream"}, content=hello(0) + message(1))
    slept.clear()
    script = Script([problem(503, Retry_After="3"), problem(429, Retry_After="9"), good])
    assert next(client_of(script).events(follow=True)).seq == 1
    assert slept == [3, 9]


def test_a_service_that_never_answers_is_told(slept: list[float]) -> None:
    script = Script([httpx.ConnectError("refused")])
    with pytest.raises(ServiceUnreachable, match="refused"):
        next(client_of(script, retries=3).events(follow=True))
    assert len(script.asked) == 4
    assert slept == [0.2, 0.4, 0.8]


def test_one_that_answered_before_is_awaited_for_ever(slept: list[float]) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        if not slept:
            return httpx.Response(200, headers={"content-type": "text/event-stream"}, content=hello(0))
        if len(slept) < 100:
            raise httpx.ConnectError("refused")
        return httpx.Response(200, headers={"content-type": "text/event-stream"}, content=message(1))

    assert next(client_of(answer).events(follow=True, after=0)).seq == 1
    assert max(slept) == 5.0


def test_a_client_that_was_too_slow_comes_back(slept: list[float]) -> None:
    told = b'event: too_slow\ndata: {"type": "too_slow", "cursor": 1}\n\n'
    streams = [hello(0) + message(1) + told, hello(1) + message(2)]
    replies = [
        httpx.Response(200, headers={"content-type": "text/event-stream"}, content=each) for each in streams
    ]
    events = client_of(Script(replies)).events(follow=True, after=0)
    assert [each.seq for each in islice(events, 2)] == [1, 2]


@pytest.mark.parametrize("data", [b"data: no\n\n", b"data: []\n\n", b'data: {"seq": "x"}\n\n'])
def test_what_is_no_event_is_not_trusted(data: bytes) -> None:
    reply = httpx.Response(200, headers={"content-type": "text/event-stream"}, content=hello(0) + data)
    with pytest.raises(UntrustedBytes):
        next(client_of(Script([reply])).events(follow=True, after=0))


def test_what_is_no_stream_of_events_is_no_feed() -> None:
    script = Script(
        [httpx.Response(200, content=b"<html>hello</html>", headers={"content-type": "text/html"})]
    )
    with pytest.raises(ServiceUnreachable, match="text/html"):
        next(client_of(script, retries=1).events(follow=True))
