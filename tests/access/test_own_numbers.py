"""A token for one map is told that map's own numbers, which say nothing of how much happens on others."""

import json
import re

import pytest
from guarded import Building, furnish, give_tokens, guarded, until
from patience import PATIENCE_S
from test_feed_of_one_map import happen
from web_socket import connect


@pytest.fixture
def building(database: str):
    """Of its own for each test: the numbers count."""
    with guarded(database) as service:
        ids = furnish(database)
        give_tokens(service)
        yield Building(service, ids)


def told(text: str) -> list[int]:
    """The numbers and cursors in what was sent."""
    return [int(each) for each in re.findall(r'"(?:seq|cursor|head|next|oldest|event_cursor)":(\d+)', text)]


def test_a_token_for_one_map_cannot_count_what_happens_on_others(building) -> None:
    """What it is told is the same, number for number, however much happens elsewhere in between."""
    service = building.service
    feed = service.app.state.feed
    until(lambda: feed.connected)
    offered = ["semap", f"bearer.{service.tokens['annex']}"]
    for elsewhere in (7, 31, 2):
        for _ in range(elsewhere):
            happen(building, "office")
        happen(building, "annex")
    last = happen(building, "office")
    until(lambda: feed.head >= last)
    now = "2100-01-01T00:00:00Z"
    with service.client("annex") as client:
        polled = client.get("/events")
        assert told(polled.text) == [1, 2, 3, 4, 4]
        assert "after=4" in polled.headers["link"]
        assert told(client.get("/events?after=2").text) == [3, 4, 4]
        assert told(client.get("/events?after=4&wait=0").text) == [4]
        assert told(client.get("/events?filter=seq%20%3E%203").text) == [4, 4]
        assert told(client.get("/events?type=nothing").text) == [4]
        assert client.get("/events?after=5").status_code == 422
        assert '"sequence":"0000000000000000004"' in client.get("/events?after=3&envelope=cloudevents").text
        assert told(client.get("/maps/annex/moment", params={"at": now}).text) == [4]
        span = {"from": "1970-01-01T00:00:00Z", "to": now}
        assert told(client.get("/maps/annex/timeline", params=span).text) == [1, 2, 3, 4]
        features = client.get("/collections/annex.events/items").json()["features"]
        assert [each["id"] for each in features] == [1, 2, 3, 4]
        with client.stream("GET", "/events/stream", headers={"Last-Event-ID": "3"}) as stream:
            lines = stream.iter_lines()
            seen = ""
            while "id: 4" not in seen:
                seen += next(lines) + "\n"
            assert max(told(seen)) == 4
    with connect(service.socket_url("/events/feed?after=1"), subprotocols=offered) as socket:
        assert told(socket.recv(timeout=PATIENCE_S)) == [1, 4, 1]
        assert told(socket.recv(timeout=PATIENCE_S)) == [4, 2, 3, 4]
        happen(building, "office")
        assert json.loads(socket.recv(timeout=PATIENCE_S)) == {"type": "heartbeat", "cursor": 4}
        happen(building, "annex")
        while '"seq":5' not in (message := socket.recv(timeout=PATIENCE_S)):
            assert json.loads(message) == {"type": "heartbeat", "cursor": 4}
        assert told(message) == [5, 5]
    with connect(service.socket_url("/maps/annex/live"), subprotocols=offered) as socket:
        assert told(socket.recv(timeout=PATIENCE_S)) == [5]


def test_a_token_for_several_maps_follows_each_by_its_own_numbers(building) -> None:
    service = building.service
    service.add_token("both", "read", maps=["annex", "office"])
    happen(building, "office")
    with service.client("both") as client:
        refused = client.get("/events")
        assert (refused.status_code, "map=annex" in refused.json()["remedy"]) == (422, True)
        assert told(client.get("/events?map=annex").text) == [1, 1]
        assert told(client.get("/events?map=office").text) == [1, 2, 2]


def test_events_of_a_map_are_found_with_its_own_numbers(building) -> None:
    service = building.service
    for name in ("office", "annex", "office"):
        happen(building, name)
    with service.client("annex") as client:
        first = client.get("/maps/annex/events?limit=1").json()
        assert [each["seq"] for each in first["events"]] == [2]
        assert first["next"].endswith(".2")
        rest = client.get(f"/maps/annex/events?before={first['next']}").json()
        assert [each["seq"] for each in rest["events"]] == [1]
        assert client.get("/maps/office/events").status_code == 404


def test_who_may_see_all_has_one_number_for_all(building) -> None:
    service = building.service
    numbers = [happen(building, name) for name in ("office", "annex", "office")]
    with service.client("read") as client:
        assert told(client.get("/events").text) == [1, 2, *numbers, numbers[-1]]
        assert told(client.get("/events?map=annex&after=2").text) == [numbers[1], numbers[-1]]
