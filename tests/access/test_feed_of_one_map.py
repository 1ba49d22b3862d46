"""A token for one map: every feed gives the events of that map and no other, from the ring and from the past."""

import json
import re

import pytest
from patience import PATIENCE_S, until
from web_socket import connect

from semap.store.database import connect as connect_database


def happen(building, map_name: str) -> int:
    """An event of a map, as the rule worker commits it; its number."""
    with connect_database(building.service.dsn) as owner:
        return owner.execute(
            "with made as (insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp,"
            " since) select 1 + (select max(seq) from semap.event), gen_random_uuid(), map_id, 'r', 1, 'entered',"
            " now(), now() from semap.map where name = %s returning seq)"
            " select seq, pg_notify('semap_event', '') from made",
            [map_name],
        ).fetchone()[0]


def own_number(building, map_name: str) -> int:
    """Of the newest event of a map, among those of this map."""
    with connect_database(building.service.dsn) as owner:
        return owner.execute(
            "select newest from semap.event_count join semap.map using (map_id) where name = %s", [map_name]
        ).fetchone()[0]


def maps_in(text: str) -> set[str]:
    return set(re.findall(r'"map":"(\w+)"', text))


@pytest.mark.parametrize("past", [False, True])
def test_every_feed_keeps_to_the_maps_of_its_token(building, past: bool) -> None:
    service = building.service
    feed = service.app.state.feed
    until(lambda: feed.connected)
    offered = ["semap", f"bearer.{service.tokens['annex']}"]
    url = service.socket_url("/events/feed?after=0")
    with (
        service.client("annex") as client,
        client.stream("GET", "/events/stream?after=0") as stream,
        connect(url, subprotocols=offered) as socket,
    ):
        happen(building, "office")
        last = happen(building, "annex")
        until(lambda: feed.head >= last)
        own = own_number(building, "annex")  # which a reader of this map alone is told
        polled = client.get("/events", params={"after": 0 if past else own - 1}).text
        assert maps_in(polled) == {"annex"}
        heard, seen = "", ""
        while f'"seq":{own},' not in heard:
            heard += socket.recv(timeout=PATIENCE_S)
        lines = stream.iter_lines()
        while f'"seq":{own},' not in seen:
            seen += next(lines)
        assert maps_in(heard) == maps_in(seen) == {"annex"}
        assert heard.count('"seq"') == seen.count('"seq"')
        if past:
            assert client.get("/events").text.count('"seq"') == heard.count('"seq"')


def test_a_map_that_the_token_may_not_see_is_not_there(building) -> None:
    service = building.service
    offered = ["semap", f"bearer.{service.tokens['annex']}"]
    with service.client("annex") as client:
        for path in ("/events", "/events/stream"):
            hidden, missing = (client.get(path, params={"map": name}) for name in ("office", "nowhere"))
            assert (hidden.status_code, missing.status_code) == (404, 404)
            assert hidden.json()["detail"] == "There is no map office."
    for path in ("/events/feed?map=office", "/maps/office/live", "/maps/nowhere/live"):
        with connect(service.socket_url(path), subprotocols=offered) as socket:
            told = json.loads(socket.recv(timeout=PATIENCE_S))
            assert (told["type"], told["detail"].split(" map ")[0]) == ("error", "There is no")
    with connect(service.socket_url("/maps/annex/live"), subprotocols=offered) as socket:
        shown = json.loads(socket.recv(timeout=PATIENCE_S))
        assert [each["name"] for each in shown["tracks"]] == ["annex person"]
        assert socket.subprotocol == "semap"
