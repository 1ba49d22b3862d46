"""Events by polling and over the WebSocket: in order, without loss, at each reader's own pace."""

import asyncio
import json
import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from datetime import timedelta
from types import SimpleNamespace
from urllib.parse import quote
from uuid import uuid4

import pytest
import shapely
from following import any_message, deaf, drained, events, message, narrow, numbers
from patience import PATIENCE_S, until
from running import START, Service
from semap_service.feed.ring import Entry, Feed
from sqlalchemy import Connection, create_engine
from web_socket import connect
from websockets.exceptions import ConnectionClosed

from semap.store.database.event_number import newest_event
from semap.timeline.stamp import rfc3339


def hello(cursor: int, head: int, oldest: int | None, resumed: str) -> dict:
    return {"type": "hello", "cursor": cursor, "head": head, "oldest": oldest, "resumed": resumed}


def is_full(connection: asyncio.Protocol) -> bool:
    return connection.transport.get_write_buffer_size() > 0


def test_an_event_says_what_happened_and_why(service: Service) -> None:
    service.make_map()
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3))
    track_id = service.walk([(-1, 1), (1, 1)])
    stamp = START + timedelta(seconds=1)
    # at once, as the worker writes it: else the feed may read the event without its evidence
    with service.plain.transaction():
        event_id, change_uid = service.plain.execute(
            "with made as (insert into semap.event select 5, gen_random_uuid(), map_id, 'room_visits', 2,"
            " 'entered', stamp, cause::text, track_id, track_name, instance_id, instance_name, since"
            " from semap.relation_change returning event_id)"
            " select event_id, uid from made, semap.relation_change"
        ).fetchone()
        service.plain.execute(
            "insert into semap.event_evidence (event_id, place, uid, variable, source, stamp)"
            " values (%s, 1, %s, '', 'relation', %s)",
            [event_id, change_uid, stamp],
        )
    event = {
        "seq": 5,
        "event_id": str(event_id),
        "map": "office",
        "type": "entered",
        "stamp": stamp.strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
        "cause": "moved",
        "rule": "room_visits",
        "rule_version": 2,
        "track": {"id": track_id, "name": "person"},
        "instance": {"id": room["id"], "name": "Room07"},
        "since": stamp.strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
        "key": {},
        "measures": {},
        "confidence": None,
        "by_batch": False,
        "verdict": None,
        "amended_by": None,
        "evidence": [
            {
                "uid": str(change_uid),
                "variable": "",
                "source": "relation",
                "stamp": stamp.strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
            }
        ],
    }
    assert service.get("/events") == {"events": [event], "next": 5}
    with connect(f"{service.feed_url}?after=4") as feed:
        assert message(feed) == hello(4, 5, 5, "replayed")
        assert message(feed) == {"type": "events", "cursor": 5, "events": [event]}


def test_an_event_of_a_pattern_says_what_it_rests_on(service: Service) -> None:
    """What the rule worker commits comes out whole: without a track, with a key, and with a verdict later."""
    service.make_map()
    ids = [str(uuid4()) for _ in range(4)]
    map_id = service.plain.execute("select map_id from semap.map").fetchone()[0]
    stamps = [rfc3339(START + timedelta(seconds=second)) for second in range(3)]
    rows = [("O", "object_state", ids[2], stamps[0]), ("E", "relation", ids[3], stamps[1])]
    evidence = [
        {"uid": uid, "variable": variable, "source": source, "stamp": stamp}
        for variable, source, uid, stamp in rows
    ]
    common = {
        "type": "kept", "stamp": stamps[2], "since": stamps[0], "rule_version": 3, "cause": None,
        "key": {"room": "Room07"}, "measures": {"gap_s": 1.5, "who": None}, "confidence": 0.25,
        "by_batch": False, "evidence": evidence,
    }  # fmt: skip
    given = [
        {
            **common,
            "event_id": uid,
            "map_id": map_id,
            "rule_name": "r",
            "instance_id": 7,
            "instance_name": "Room07",
        }
        for uid in ids[:2]
    ]
    service.plain.execute(
        "select semap.commit_progress('rules', lsn, lsn, null, null, '{}', %s) from semap.progress",
        [json.dumps(given)],
    )
    expected = {
        **common, "seq": 1, "event_id": ids[0], "map": "office", "rule": "r", "track": None,
        "instance": {"id": 7, "name": "Room07"}, "verdict": None, "amended_by": None,
    }  # fmt: skip
    first, second = service.get("/events")["events"]
    assert first == expected
    assert second == {**expected, "seq": 2, "event_id": ids[1]}
    service.plain.execute(
        "with run as (insert into semap.recompute_run (map_id, from_stamp, to_stamp)"
        " values (%s, now(), now()) returning run_id)"
        " insert into semap.event_amendment (event_id, verdict, by_event_id, run_id)"
        " select %s, 'amended', %s, run_id from run",
        [map_id, *ids[:2]],
    )
    assert service.get("/events", limit=1)["events"] == [
        {**expected, "verdict": "amended", "amended_by": ids[1]}
    ]


def test_polling_goes_on_at_its_cursor(service: Service) -> None:
    service.make_map()
    service.make_map("other")
    service.happen(1, 5)
    service.happen(6, 2, map_name="other", kind="left")
    first = service.get("/events", limit=3)
    assert (numbers(first["events"]), first["next"]) == ([1, 2, 3], 3)
    second = service.get("/events", after=3)
    assert (numbers(second["events"]), second["next"]) == ([4, 5, 6, 7], 7)
    assert service.get("/events", after=7) == {"events": [], "next": 7}
    assert numbers(service.get("/events", map="other", type="left")["events"]) == [6, 7]
    assert numbers(service.get("/events", rule="room_visits", limit=2)["events"]) == [1, 2]
    assert numbers(service.get("/events", rule="other")["events"]) == []
    nothing = service.get("/events", map="office", type="left")
    assert nothing == {"events": [], "next": 7}
    assert service.client.get("/events?map=nowhere").status_code == 404
    assert service.client.get("/events?wait=61").status_code == 422
    assert service.client.get("/events?after=-1").status_code == 422
    beyond = service.client.get("/events?after=8&wait=60")
    assert (beyond.status_code, beyond.json()["detail"][:40]) == (
        422,
        "after: 8 is beyond the newest event, 7",
    )


def test_a_waiting_poll_is_answered_by_the_first_event(service: Service) -> None:
    service.make_map()
    service.make_map("other")
    with ThreadPoolExecutor() as pool, connect(service.feed_url) as feed:
        assert message(feed)["type"] == "hello"
        waiting = pool.submit(service.get, "/events", wait=60, map="office")
        service.happen(1, map_name="other")
        assert message(feed)["cursor"] == 1
        assert not waiting.done()
        service.happen(2)
        assert numbers(waiting.result()["events"]) == [2]
    assert service.get("/events", after=2, wait=0.2) == {"events": [], "next": 2}


def test_a_wait_ends_when_the_server_stops(service: Service) -> None:
    service.make_map()
    with ThreadPoolExecutor() as pool:
        waiting = pool.submit(service.raw.get, "/events?wait=60")
        service.until(lambda: service.server_feed.clients["poll"] == 1)
        service.server.should_exit = True
        assert waiting.result().json() == {"events": [], "next": 0}


def test_a_wait_outlasts_the_events_that_its_reader_knows() -> None:
    """A reader of the database may be ahead of the ring, which then catches up with what is no news to it."""

    def entry(seq: int) -> Entry:
        return Entry(SimpleNamespace(seq=seq, map="office", own_seq=seq), b"{}")

    async def play() -> None:
        feed = Feed(create_engine("postgresql+psycopg://"), "")
        waiting = asyncio.create_task(feed.wait(1, 10))
        await asyncio.sleep(0)
        feed._append([entry(1)])
        for _ in range(10):
            await asyncio.sleep(0)
        assert not waiting.done()
        feed._append([entry(2)])
        assert await waiting

    asyncio.run(play())


def test_the_feed_needs_no_connection_of_those_that_requests_have(database: str) -> None:
    async def play() -> None:
        # one that cannot connect, as one whose connections are all taken
        feed = Feed(create_engine("postgresql+psycopg://localhost:1/nothing"), database)
        following = asyncio.create_task(feed.run())
        await asyncio.to_thread(until, lambda: feed.connected)
        following.cancel()
        with suppress(asyncio.CancelledError):
            await following

    asyncio.run(play())


def test_the_feed_begins_at_the_head_and_resumes_at_a_cursor(service: Service) -> None:
    service.make_map()
    service.happen(1, 3)
    with connect(service.feed_url) as feed:
        assert message(feed) == hello(3, 3, 1, "nothing_missed")
        service.happen(4, 2)
        assert numbers(events(feed, 2)) == [4, 5]
    service.happen(6, 1500)
    with connect(f"{service.feed_url}?after=2") as feed:
        assert message(feed) == hello(2, 1505, 1, "replayed")
        assert numbers(events(feed, 1503)) == list(range(3, 1506))
        service.happen(1506)
        assert numbers(events(feed, 1)) == [1506]


@pytest.mark.parametrize("ring", ["within the ring", "beyond it"])
def test_resuming_says_what_it_gave(service: Service, ring: str) -> None:
    """By a model: what was selected and kept after the cursor follows, no more and no less."""
    service.make_map()
    service.make_map("other")
    service.happen(1, 10)
    service.happen(11, 10, map_name="other")
    service.plain.execute("delete from semap.event where seq <= 4")
    if ring == "beyond it":
        service.server_feed._floor = 20
        service.server_feed._ring.clear()
    for after in (0, 3, 4, 9, 10, 15, 20):
        kept = [seq for seq in range(1, 21) if seq > max(after, 4)]
        for query, wanted in (
            ("", kept),
            ("&map=office", [seq for seq in kept if seq <= 10]),
            ("&map=other&type=left", []),
            (f"&filter={quote('seq > 12 and seq < 14')}", [seq for seq in kept if seq == 13]),
        ):
            with connect(f"{service.feed_url}?after={after}{query}") as feed:
                gap = after < 4
                said = "no_longer_kept" if gap else "replayed" if wanted else "nothing_missed"
                assert message(feed) == hello(max(after, 4), 20, 5, said), query
                assert numbers(events(feed, len(wanted))) == wanted
    # a database that was set back to before them
    service.plain.execute("delete from semap.event; update semap.progress set event_seq = 0")
    with connect(f"{service.feed_url}?after=7") as feed:
        assert message(feed)["type"] == "error"
    service.plain.execute("update semap.progress set event_seq = 20")
    with connect(f"{service.feed_url}?after=7") as feed:
        assert message(feed) == hello(20, 20, None, "no_longer_kept")
        service.happen(21)
        assert numbers(events(feed, 1)) == [21]


def test_what_is_committed_while_somebody_comes_back_has_not_been_deleted(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    def as_the_first_is_committed(connection: Connection, of_map: str | None) -> int:
        monkeypatch.undo()
        service.happen(1)
        return newest_event(connection, of_map)

    service.make_map()
    monkeypatch.setattr("semap.store.event.events.newest_event", as_the_first_is_committed)
    with connect(f"{service.feed_url}?after=0") as feed:
        assert message(feed)["resumed"] in ("replayed", "nothing_missed")
        assert numbers(events(feed, 1)) == [1]


def test_the_feed_selects(service: Service) -> None:
    service.make_map()
    service.make_map("other")
    with (
        connect(f"{service.feed_url}?rule=none") as nobody,
        connect(f"{service.feed_url}?map=office&type=left&rule=room_visits") as feed,
    ):
        assert message(nobody)["type"] == "hello"
        assert message(feed)["type"] == "hello"
        service.happen(1, 3, map_name="other", kind="left")
        service.happen(4, 3)
        service.happen(7, kind="left")
        assert numbers(events(feed, 1)) == [7]
        service.until(lambda: any_message(nobody) == {"type": "heartbeat", "cursor": 7})


def test_silence_is_filled_with_heartbeats(service: Service) -> None:
    service.make_map()
    service.happen(1)
    with connect(f"{service.feed_url}?type=left") as feed:
        assert message(feed)["cursor"] == 1
        assert any_message(feed) == {"type": "heartbeat", "cursor": 1}
        service.happen(2)
        service.until(lambda: any_message(feed) == {"type": "heartbeat", "cursor": 2})


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("after=8", "8 is beyond the newest event, 7"),
        ("after=-1", "no number of an event"),
        ("after=x", "no number of an event"),
        (f"after={10**40}", "no number of an event"),
        ("map=nowhere", "There is no map nowhere."),
        ("envelope=avro", "'avro' is no envelope"),
        ("filter=colour%20%3D%201", "there is no property colour"),
        ("filter=type%20%3D", "filter"),
        ("filter=isA('Room')", "an event is of no concept"),
    ],
)
def test_what_cannot_be_followed_is_refused(service: Service, query: str, words: str) -> None:
    service.make_map()
    service.happen(7)
    with connect(f"{service.feed_url}?{query}") as feed:
        refusal = message(feed)
        assert refusal["type"] == "error"
        assert words in refusal["detail"]
        assert refusal["remedy"]
        with pytest.raises(ConnectionClosed) as caught:
            feed.recv(timeout=PATIENCE_S)
    assert caught.value.rcvd.code == 4400
    assert words.split("'", maxsplit=1)[0] in caught.value.rcvd.reason


@pytest.mark.parametrize("kind", ["socket", "stream"])
def test_a_reader_that_does_not_read_is_told_and_holds_up_nobody(service: Service, kind: str) -> None:
    service.make_map()
    service.pace(patience_s=1.5)
    with deaf(service, "after=0", kind) as slow, connect(f"{service.feed_url}?after=0") as feed:
        assert message(feed)["type"] == "hello"
        for first in range(1, 10_001, 2500):
            service.happen(first, 2500)
        assert numbers(events(feed, 10_000)) == list(range(1, 10_001))
        service.until(lambda: service.server_feed.too_slow == 1)
        received = drained(slow)
    assert b"too_slow" in received
    told = [int(seq) for seq in re.findall(rb'"seq":(\d+)', received)]
    assert told == list(range(1, len(told) + 1))
    cursor = int(re.search(rb'"too_slow","cursor":(\d+)', received)[1])
    assert cursor == told[-1]
    if kind == "socket":
        assert received[-12:-10] == b"\x88\x0a"
        assert received[-10:] == (4408).to_bytes(2, "big") + b"too slow"
    service.until(lambda: not +service.server_feed.clients)
    assert service.server_feed.too_slow == 1


@pytest.mark.parametrize("kind", ["socket", "stream"])
def test_who_takes_nothing_even_then_is_cut_off(
    service: Service, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semap_service.http.connection.CLOSE_S", 0.2)
    service.make_map()
    service.pace(patience_s=0.2)
    service.happen(1, 5000)
    with deaf(service, "after=0", kind) as slow:
        service.until(lambda: service.server_feed.too_slow == 1)
        service.until(lambda: not +service.server_feed.clients)
        service.until(lambda: not [each for each in service.server.server_state.connections if is_full(each)])
        with pytest.raises(ConnectionResetError):
            drained(slow)


def test_who_falls_ever_further_behind_is_told(service: Service) -> None:
    """It takes each message in time, but far fewer than there are."""
    service.make_map()
    service.pace(patience_s=15, most_behind=1000)
    with narrow(service) as made, connect(service.feed_url, sock=made, max_queue=1) as slow:
        assert message(slow)["type"] == "hello"
        last = 15_000
        service.happen(1, last)
        seen: list[int] = []
        while (received := message(slow))["type"] == "events":
            seen += numbers(received["events"])
            service.happen(last + 1, 2_000)
            last += 2_000
        assert seen == list(range(1, len(seen) + 1))
        assert (received["type"], received["cursor"]) == ("too_slow", len(seen))
        assert "events behind" in received["detail"]
        with pytest.raises(ConnectionClosed) as caught:
            slow.recv(timeout=PATIENCE_S)
        assert caught.value.rcvd.code == 4408


def test_a_reader_behind_the_ring_reads_on_from_the_database(service: Service) -> None:
    service.make_map()
    with connect(f"{service.feed_url}?after=0") as slow:
        assert message(slow)["type"] == "hello"
        service.happen(1, 12_000)
        assert numbers(service.get("/events", after=11_999, wait=10)["events"]) == [12_000]
        assert numbers(events(slow, 12_000)) == list(range(1, 12_001))


def test_the_feed_survives_the_loss_of_its_connections(service: Service) -> None:
    service.make_map()
    with connect(service.feed_url) as feed:
        assert message(feed)["type"] == "hello"
        for number in range(1, 4):
            service.plain.execute(
                "select pg_terminate_backend(pid) from pg_stat_activity"
                " where datname = current_database() and application_name in ('semap feed', 'semap serve')"
            )
            service.happen(number)
            assert numbers(events(feed, 1)) == [number]


def test_a_lost_notification_is_made_up_for(service: Service) -> None:
    service.make_map()
    with connect(service.feed_url) as feed:
        assert message(feed)["type"] == "hello"
        service.plain.execute(
            "insert into semap.event select 1, gen_random_uuid(), map_id, 'r', 1, 'entered', now(), 'moved',"
            " 1, 'a', 1, 'b', now() from semap.map"
        )
        assert numbers(events(feed, 1)) == [1]


def test_each_event_arrives_by_itself(service: Service) -> None:
    service.make_map()
    with connect(service.feed_url) as feed:
        assert message(feed)["type"] == "hello"
        for number in range(1, 41):
            service.happen(number)
            assert numbers(events(feed, 1)) == [number]
