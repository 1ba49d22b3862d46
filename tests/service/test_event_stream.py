"""Events as server-sent events, in CloudEvents envelopes, and with filters: the same as by polling."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import quote

import httpx
import pytest
import shapely
import uvicorn
from cloudevents.core.formats.json import JSONFormat
from cloudevents.core.v1.event import CloudEvent
from fastapi import FastAPI
from following import any_message, deaf, events, message, numbers, stream
from jsonschema import Draft202012Validator
from patience import PATIENCE_S, until
from running import Service
from semap_service.processes.port import free_port
from semap_service.serving.app import create_app
from semap_service.serving.uvicorn_server import OPTIONS
from starlette.middleware.gzip import GZipMiddleware
from web_socket import connect


@contextmanager
def serving(app: FastAPI, port: int) -> Iterator[tuple[uvicorn.Server, str]]:
    """A server of its own, until it is told to stop."""
    config = uvicorn.Config(app, port=port, log_level="error", timeout_graceful_shutdown=2, **OPTIONS)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    until(lambda: server.started or not thread.is_alive())
    assert server.started
    yield server, f"http://127.0.0.1:{port}"
    server.should_exit = True
    thread.join()


def test_a_stream_says_hello_and_then_each_event(service: Service) -> None:
    service.make_map()
    service.happen(1, 3)
    listed = service.get("/events")["events"]
    with stream(service, after=1) as messages:
        hello = {"type": "hello", "cursor": 1, "head": 3, "oldest": 1, "resumed": "replayed"}
        assert next(messages) == {"id": "1", "event": "hello", "data": hello}
        assert [next(messages) for _ in range(2)] == [
            {"id": str(each["seq"]), "event": "message", "data": each} for each in listed[1:]
        ]
        service.happen(4)
        assert next(messages)["id"] == "4"


def test_a_browser_that_comes_back_goes_on(service: Service) -> None:
    """Last-Event-ID comes before `after`, which stays in the address that a browser calls again."""
    service.make_map()
    service.happen(1, 5)
    with stream(service, {"Last-Event-ID": "3"}, after=1) as messages:
        assert next(messages)["data"]["resumed"] == "replayed"
        assert [next(messages)["id"] for _ in range(2)] == ["4", "5"]
    with stream(service) as messages:
        assert next(messages) == {
            "id": "5",
            "event": "hello",
            "data": {"type": "hello", "cursor": 5, "head": 5, "oldest": 1, "resumed": "nothing_missed"},
        }


def test_silence_moves_the_cursor_on(service: Service) -> None:
    """So that a browser that comes back does not go through all that it did not want once more."""
    service.make_map()
    with service.raw.stream("GET", "/events/stream?type=left") as response:
        assert response.headers["content-type"].partition(";")[0] == "text/event-stream"
        assert response.headers["cache-control"] == "no-store, no-transform"
        assert response.headers["x-accel-buffering"] == "no"
        lines = response.iter_lines()
        assert next(lines) == "retry: 1000"
        service.happen(1, 7)
        while next(lines) != "id: 7":
            pass


@pytest.mark.parametrize(
    ("query", "status", "words"),
    [
        ("after=8", 422, "8 is beyond the newest event, 7"),
        ("after=-1", 422, "after"),
        ("map=nowhere", 404, "There is no map nowhere."),
        ("filter=colour%3D1", 422, "there is no property colour"),
        ("envelope=avro", 422, "cloudevents"),
    ],
)
def test_what_cannot_be_streamed_is_a_problem(service: Service, query: str, status: int, words: str) -> None:
    service.make_map()
    service.happen(7)
    answer = service.client.get(f"/events/stream?{query}")
    assert (answer.status_code, words in answer.json()["detail"]) == (status, True), answer.text
    wrong = service.client.get("/events/stream", headers={"Last-Event-ID": "x"})
    assert (wrong.status_code, wrong.json()["errors"][0]["where"]) == (422, "Last-Event-ID")


def test_every_way_gives_the_same_cloud_events(service: Service) -> None:
    service.make_map()
    service.make_map("Büro 2")
    service.happen(1, 2)
    service.happen(3, 1, map_name="Büro 2", kind="left")
    answer = service.client.get("/events?envelope=cloudevents&after=1")
    assert answer.headers["content-type"] == "application/cloudevents-batch+json"
    polled = answer.json()
    bare = service.get("/events", after=1)
    assert [each["data"] for each in polled] == bare["events"]
    for each in polled:
        read = JSONFormat().read(CloudEvent, json.dumps(each))
        assert int(read.get_extension("sequence")) == each["data"]["seq"]
    assert [each["source"] for each in polled] == ["/maps/office", "/maps/B%C3%BCro%202"]
    assert answer.links["next"]["url"] == "/events?envelope=cloudevents&after=3"
    assert service.client.get(answer.links["next"]["url"]).json() == []
    with connect(f"{service.feed_url}?after=1&envelope=cloudevents") as feed:
        message(feed)
        assert message(feed) == {"type": "events", "cursor": 3, "events": polled}
    with stream(service, after=1, envelope="cloudevents") as messages:
        next(messages)
        assert [next(messages)["data"] for _ in range(2)] == polled
    schema = service.client.get(polled[0]["dataschema"])
    assert schema.headers["content-type"] == "application/schema+json"
    assert schema.json()["$id"] == polled[0]["dataschema"]
    for each in polled:
        Draft202012Validator(schema.json()).validate(each["data"])


def test_every_way_takes_the_same_filter(service: Service) -> None:
    service.make_map()
    service.happen(1, 30)
    text = "seq > 10 AND instance = 'Room07' AND (seq < 13 OR seq = 25)"
    assert numbers(service.get("/events", filter=text)["events"]) == [11, 12, 25]
    assert service.get("/events", filter=text, after=25) == {"events": [], "next": 30}
    assert service.get("/events", filter=text, limit=2)["next"] == 12
    with connect(f"{service.feed_url}?after=0&filter={quote(text)}") as feed:
        assert message(feed)["resumed"] == "replayed"
        assert numbers(events(feed, 3)) == [11, 12, 25]
    with stream(service, after=0, filter=text) as messages:
        next(messages)
        assert [next(messages)["id"] for _ in range(3)] == ["11", "12", "25"]


def test_a_filter_may_ask_where_it_happened(service: Service) -> None:
    """Where the track was at that moment; where that is not known, where the instance is."""
    service.make_map()
    room = service.make_room("Room07", shapely.box(10, 10, 14, 13))["id"]
    track = service.walk([(1, 1), (5, 5)])
    service.happen(1, 3)
    service.plain.execute("update semap.event set instance_id = %s", [room])
    service.plain.execute(
        "update semap.event set track_id = %s, stamp = stamp + make_interval(secs => seq - 1) where seq < 3",
        [track],
    )
    for box, found in (("0, 0, 2, 2", [1]), ("4, 4, 6, 6", [2]), ("9, 9, 15, 15", [3])):
        text = f"S_INTERSECTS(place, BBOX({box}))"
        assert numbers(service.get("/events", filter=text)["events"]) == found
    assert service.get("/events", filter="place IS NULL")["events"] == []


def test_the_feed_looks_places_up_for_those_who_ask(service: Service) -> None:
    """Of events that came before somebody asked, and of those that come while somebody does."""
    service.make_map()
    inside = service.walk([(1, 1)])
    feed = service.server_feed
    by_place = f"{service.feed_url}?after=0&filter={quote('S_INTERSECTS(place, BBOX(0, 0, 2, 2))')}"
    with connect(f"{service.feed_url}?after=0") as everything:
        assert message(everything)["type"] == "hello"
        service.happen(1, 2, track_id=inside)
        service.happen(3, track_id=inside + 1)
        assert numbers(events(everything, 3)) == [1, 2, 3]
        assert {entry.event.place for entry in feed._ring} == {None}
        with connect(by_place) as some:
            assert message(some)["resumed"] == "replayed"
            assert numbers(events(some, 2)) == [1, 2]
            service.happen(4, track_id=inside + 1)
            service.happen(5, track_id=inside)
            assert numbers(events(some, 1)) == [5]
            assert shapely.from_wkb(feed._ring[-1].event.place) == shapely.Point(1, 1)
        assert numbers(events(everything, 2)) == [4, 5]
    until(lambda: not feed._placing)
    service.happen(6, track_id=inside)
    with connect(by_place.replace("after=0", "after=4")) as some:
        assert message(some)["resumed"] == "replayed"
        assert numbers(events(some, 2)) == [5, 6]


def test_a_filter_that_takes_little_is_searched_for_in_pieces(
    service: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("semap.store.events.LOOKED_AT", 10)
    service.make_map()
    service.happen(1, 95)
    for query in ({"filter": "seq = 94"}, {"type": "left"}):
        found = service.get("/events", **query)
        assert (numbers(found["events"]), found["next"]) == ([94] if "filter" in query else [], 95)
    service.server_feed._ring.clear()
    service.server_feed._floor = 95
    with connect(f"{service.feed_url}?after=3&filter=seq%20%3D%2094") as feed:
        assert message(feed)["resumed"] == "replayed"
        assert numbers(events(feed, 1)) == [94]


def test_asyncapi_describes_every_message(service: Service) -> None:
    document = service.client.get("/asyncapi.json").json()
    assert document["servers"]["here"]["host"] == service.url.removeprefix("http://")
    schemas = document["components"]["schemas"]
    named = {each["name"]: each["payload"]["$ref"] for each in document["components"]["messages"].values()}
    service.make_map()
    service.happen(1)
    with connect(f"{service.feed_url}?after=0") as feed:
        received = [any_message(feed) for _ in range(3)]
    for each, name in zip(received, ("Hello", "Events", "Heartbeat"), strict=True):
        target = schemas[named[name].rpartition("/")[2]]
        Draft202012Validator({**target, "components": {"schemas": schemas}}).validate(each)


def test_a_stream_is_not_held_back_to_be_compressed(database: str) -> None:
    app = create_app(database, heartbeat_s=5, without_tokens=True)
    app.add_middleware(GZipMiddleware, minimum_size=0)
    with (
        serving(app, free_port()) as (_, url),
        httpx.stream("GET", f"{url}/events/stream", headers={"Accept-Encoding": "gzip"}) as response,
    ):
        assert "content-encoding" not in response.headers
        assert next(response.iter_lines()) == "retry: 1000"


def test_a_stream_ends_with_the_server_and_goes_on_at_the_next(service: Service) -> None:
    """Nothing is missed or repeated, though the server is stopped while events come, and another takes over."""
    service.make_map()
    seen: list[int] = []
    port = free_port()
    last = "0"
    for number in range(3):
        app = create_app(service.app.state.feed._dsn, heartbeat_s=0.3, without_tokens=True)
        with serving(app, port) as (server, url), httpx.Client(base_url=url, timeout=PATIENCE_S) as client:
            service.happen(100 * number + 1, 50)
            with client.stream("GET", "/events/stream", headers={"Last-Event-ID": last}) as response:
                lines = response.iter_lines()
                while len(seen) < 50 * (2 * number + 1):
                    line = next(lines)
                    if line.startswith("data: ") and '"seq":' in line:
                        seen.append(json.loads(line.removeprefix("data: "))["seq"])
                        last = str(seen[-1])
                server.should_exit = True
                assert not [line for line in lines if line.startswith("data: ")]
            service.happen(100 * number + 51, 50)
        if number < 2:
            seen_before = len(seen)
            with stream(service, {"Last-Event-ID": last}) as messages:
                next(messages)
                seen += [next(messages)["data"]["seq"] for _ in range(50)]
            last = str(seen[-1])
            assert len(seen) == seen_before + 50
    assert seen == list(range(1, len(seen) + 1))


@pytest.mark.parametrize("kind", ["socket", "stream"])
def test_who_goes_without_a_word_is_forgotten(service: Service, kind: str) -> None:
    service.make_map()
    service.happen(1, 100)
    for _ in range(5):
        gone = deaf(service, "after=0", kind)
        service.until(lambda: +service.server_feed.clients)
        gone.close()
        service.until(lambda: not +service.server_feed.clients)
    assert service.app.state.channels._open == {}
