"""Events by polling and over the WebSocket: in order, without loss, at each reader's own pace."""

import asyncio
import json
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from types import SimpleNamespace
from uuid import uuid4

import pytest
import shapely
from running import START, Service
from semap_service.document import rfc3339
from semap_service.feed import Feed
from sqlalchemy import create_engine
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect


def numbers(page: dict) -> list[int]:
    return [each["seq"] for each in page["events"]]


def message(feed) -> dict:
    """The next message that is not a heartbeat."""
    while True:
        received = json.loads(feed.recv(timeout=10))
        if received["type"] != "heartbeat":
            return received


def test_an_event_says_what_happened_and_why(service: Service) -> None:
    service.make_map()
    room = service.make_room("Room07", shapely.box(0, 0, 4, 3))
    track_id = service.walk([(-1, 1), (1, 1)])
    stamp = START + timedelta(seconds=1)
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
        assert message(feed) == {"type": "hello", "cursor": 4, "head": 5}
        assert message(feed) == {"type": "event", "cursor": 5, "event": event}


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
    assert (numbers(first), first["next"]) == ([1, 2, 3], 3)
    second = service.get("/events", after=3)
    assert (numbers(second), second["next"]) == ([4, 5, 6, 7], 7)
    assert service.get("/events", after=7) == {"events": [], "next": 7}
    assert numbers(service.get("/events", map="other", type="left")) == [6, 7]
    assert numbers(service.get("/events", rule="room_visits", limit=2)) == [1, 2]
    assert numbers(service.get("/events", rule="other")) == []
    nothing = service.get("/events", map="office", type="left")
    assert nothing == {"events": [], "next": 7}
    assert service.client.get("/events?map=nowhere").status_code == 404
    assert service.client.get("/events?wait=61").status_code == 422
    assert service.client.get("/events?after=-1").status_code == 422


def test_a_waiting_poll_is_answered_by_the_first_event(service: Service) -> None:
    service.make_map()
    service.make_map("other")
    with ThreadPoolExecutor() as pool, connect(service.feed_url) as feed:
        assert message(feed)["type"] == "hello"
        waiting = pool.submit(service.get, "/events", wait=10, map="office")
        service.happen(1, map_name="other")
        assert message(feed)["cursor"] == 1
        assert not waiting.done()
        service.happen(2)
        happened_s = time.monotonic()
        assert numbers(waiting.result()) == [2]
        assert time.monotonic() - happened_s < 0.5
    began_s = time.monotonic()
    assert service.get("/events", after=2, wait=0.2) == {"events": [], "next": 2}
    assert time.monotonic() - began_s >= 0.2


def test_a_wait_outlasts_the_events_that_its_reader_knows() -> None:
    """A reader of the database may be ahead of the ring, which then catches up with what is no news to it."""

    async def play() -> None:
        feed = Feed(create_engine("postgresql+psycopg://"), "")
        waiting = asyncio.create_task(feed.wait(1, 10))
        await asyncio.sleep(0)
        feed._append([SimpleNamespace(seq=1)])
        for _ in range(10):
            await asyncio.sleep(0)
        assert not waiting.done()
        feed._append([SimpleNamespace(seq=2)])
        assert await waiting

    asyncio.run(play())


def test_the_feed_begins_at_the_head_and_resumes_at_a_cursor(service: Service) -> None:
    service.make_map()
    service.happen(1, 3)
    with connect(service.feed_url) as feed:
        assert message(feed) == {"type": "hello", "cursor": 3, "head": 3}
        service.happen(4, 2)
        assert [message(feed)["cursor"] for _ in range(2)] == [4, 5]
    service.happen(6, 500)
    with connect(f"{service.feed_url}?after=2") as feed:
        assert message(feed) == {"type": "hello", "cursor": 2, "head": 505}
        received = [message(feed) for _ in range(503)]
        service.happen(506)
        received.append(message(feed))
    assert [each["cursor"] for each in received] == list(range(3, 507))
    assert [each["event"]["seq"] for each in received] == list(range(3, 507))


def test_the_feed_selects(service: Service) -> None:
    service.make_map()
    service.make_map("other")
    with (
        connect(f"{service.feed_url}?rule=none") as deaf,
        connect(f"{service.feed_url}?map=office&type=left&rule=room_visits") as feed,
    ):
        assert message(deaf)["type"] == "hello"
        assert message(feed)["type"] == "hello"
        service.happen(1, 3, map_name="other", kind="left")
        service.happen(4, 3)
        service.happen(7, kind="left")
        assert message(feed)["cursor"] == 7
        service.until(lambda: json.loads(deaf.recv(timeout=5)) == {"type": "heartbeat", "cursor": 7})


def test_silence_is_filled_with_heartbeats(service: Service) -> None:
    service.make_map()
    service.happen(1)
    with connect(f"{service.feed_url}?type=left") as feed:
        assert message(feed)["cursor"] == 1
        assert json.loads(feed.recv(timeout=5)) == {"type": "heartbeat", "cursor": 1}
        service.happen(2)
        service.until(lambda: json.loads(feed.recv(timeout=5)) == {"type": "heartbeat", "cursor": 2})


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("after=8", "8 is beyond the newest event, 7"),
        ("after=-1", "no number of an event"),
        ("after=x", "no number of an event"),
        (f"after={10**40}", "no number of an event"),
        ("map=nowhere", "There is no map nowhere."),
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
            feed.recv(timeout=5)
    assert caught.value.rcvd.code == 4400
    assert words.split("'", maxsplit=1)[0] in caught.value.rcvd.reason


def test_a_reader_that_does_not_read_blocks_nobody(service: Service) -> None:
    service.make_map()
    port = int(service.url.rsplit(":", 1)[1])
    with socket.create_connection(("127.0.0.1", port)) as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(
            b"GET /events/feed?after=0 HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        )
        with connect(f"{service.feed_url}?after=0") as feed:
            assert message(feed)["type"] == "hello"
            for first in range(1, 20_001, 5000):
                service.happen(first, 5000)
            assert [message(feed)["cursor"] for _ in range(20_000)] == list(range(1, 20_001))
        assert numbers(service.get("/events", after=19_999)) == [20_000]


def test_a_reader_behind_the_ring_reads_on_from_the_database(service: Service) -> None:
    service.make_map()
    with connect(f"{service.feed_url}?after=0") as slow:
        assert message(slow)["type"] == "hello"
        service.happen(1, 25_000)
        assert numbers(service.get("/events", after=24_999, wait=10)) == [25_000]
        assert [message(slow)["cursor"] for _ in range(25_000)] == list(range(1, 25_001))


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
            assert message(feed)["cursor"] == number


def test_a_lost_notification_is_made_up_for(service: Service) -> None:
    service.make_map()
    with connect(service.feed_url) as feed:
        assert message(feed)["type"] == "hello"
        service.plain.execute(
            "insert into semap.event select 1, gen_random_uuid(), map_id, 'r', 1, 'entered', now(), 'moved',"
            " 1, 'a', 1, 'b', now() from semap.map"
        )
        assert message(feed)["cursor"] == 1


def test_an_event_arrives_within_milliseconds(service: Service) -> None:
    service.make_map()
    took_s = []
    with connect(service.feed_url) as feed:
        assert message(feed)["type"] == "hello"
        for number in range(1, 41):
            service.happen(number)
            committed_s = time.monotonic()
            assert message(feed)["cursor"] == number
            took_s.append(time.monotonic() - committed_s)
    assert sorted(took_s)[len(took_s) // 2] < 0.1
