"""One service for maps on two databases: it finds each, lists all, and tokens hold on both."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import UTC, datetime

import httpx
import pytest
from server import database_with_slot
from shard.serving import FLAT, MAPS, Campus, campus
from web_socket import connect as connect_socket

from semap.cluster import Cluster
from semap.store.database.connection import connect, one_transaction
from semap.store.operate.shards import add_shard, drain_shard, place_map

LISTS = {
    "/maps": "maps",
    "/instances": "instances",
    "/rooms": "rooms",
    "/tracks": "tracks",
    "/sources": "sources",
    "/queries": "queries",
    "/rules": "rules",
    "/relations": "relations",
}
ASKED = {"/relations": {"as_of": "1970-01-01T00:00:02Z"}}


@pytest.fixture(scope="module")
def both(cluster: Cluster, template: str) -> Iterator[Campus]:
    with (
        database_with_slot(cluster, template) as directory,
        database_with_slot(cluster, template) as north,
    ):
        add_shard(directory, "north", north)
        with campus(directory, north) as made:
            yield made


def pages(client: httpx.Client, path: str, key: str, limit: int) -> list[dict]:
    found: list[dict] = []
    after: dict[str, object] = {}
    while after is not None:
        answer = client.get(path, params={"limit": limit, **ASKED.get(path, {}), **after})
        assert answer.status_code == 200, answer.text
        page = answer.json()
        assert len(page[key]) <= limit
        found += page[key]
        after = None if page["next"] is None else {"after": page["next"]}
    return found


def finished(client: httpx.Client, waiting: httpx.Response) -> dict:
    job = waiting.json()
    while job["finished_at"] is None:
        job = client.get(waiting.headers["location"], params={"wait": 60}).json()
    return job


@pytest.mark.parametrize("path", LISTS)
@pytest.mark.parametrize("limit", [1, 2, 3, 100])
def test_a_list_over_all_maps_is_that_of_each_shard_in_pages_of_any_size(
    both: Campus, path: str, limit: int
) -> None:
    key = LISTS[path]
    with both.service.client("read") as client:
        found = pages(client, path, key, limit)
        of_each = [
            each
            for name in MAPS
            for each in client.get(path, params={"map": name, "limit": 1000, **ASKED.get(path, {})}).json()[
                key
            ]
        ]
        if path == "/maps":
            of_each = [client.get(f"/maps/{name}").json() for name in MAPS]
    assert found == sorted(of_each, key=lambda each: each["name"] if path == "/maps" else each.get("id", 0))
    assert {each.get("map", each["name" if path == "/maps" else "map"]) for each in found} == set(MAPS)


def test_lists_have_an_etag_of_all_shards(both: Campus) -> None:
    with both.service.client("read") as client:
        first = client.get("/maps")
        again = client.get("/maps", headers={"If-None-Match": first.headers["etag"]})
        other = client.get("/maps?limit=1")
    assert (first.status_code, again.status_code, again.content) == (200, 304, b"")
    assert other.headers["etag"] != first.headers["etag"]


def test_what_is_wrong_is_answered_as_by_one_database(both: Campus) -> None:
    with both.service.client("read") as client:
        assert client.get("/maps?limit=0").status_code == 422
        assert client.get("/maps/nowhere").status_code == 404
        assert client.get(f"/instances/{2**47 * 7 + 1}").status_code == 404
        assert client.get("/rules?map=nowhere").status_code == 404


@pytest.mark.parametrize("name", ["office", "wing"])
def test_each_thing_is_found_by_its_number(both: Campus, name: str) -> None:
    ids = both.ids[name]
    with both.service.client("read") as client:
        for path in (
            f"/instances/{ids['instance']}",
            f"/rooms/{ids['instance']}/occupants",
            f"/tracks/{ids['track']}",
            f"/tracks/{ids['track']}/rooms",
            f"/sources/{ids['source']}",
            f"/queries/{ids['query']}",
            f"/rules/{ids['rule']}",
            f"/frames/{ids['frame']}",
            f"/descriptions/{ids['description']}",
            f"/changes/{ids['change']}",
            f"/maps/{name}/frames",
            f"/maps/{name}/export",
            f"/maps/{name}/moment?at=1970-01-01T00:00:03Z",
            f"/collections/{name}.Room/items",
        ):
            answer = client.get(path)
            assert answer.status_code == 200, (path, answer.text)
        assert client.get(f"/tracks/{ids['track']}").json()["name"] == f"{name} person"
        assert client.get(f"/collections/{name}.Room/items").json()["numberMatched"] == 1


def test_collections_are_those_of_all_maps_in_pages(both: Campus) -> None:
    with both.service.client("read") as client:
        every = client.get("/collections").json()
        assert every["numberReturned"] == len(every["collections"])
        assert list(dict.fromkeys(each["id"].partition(".")[0] for each in every["collections"])) == sorted(
            MAPS
        )
        found, path = [], "/collections?limit=7"
        while path:
            answer = client.get(path)
            page = answer.json()
            found += page["collections"]
            path = next((each["href"] for each in page["links"] if each["rel"] == "next"), "")
            assert ('rel="next"' in answer.headers["link"]) == bool(path)
        assert found == every["collections"]


def test_a_token_for_one_map_sees_that_map_alone_on_any_shard(both: Campus) -> None:
    with both.service.client("wing") as client:
        for path, key in LISTS.items():
            found = pages(client, path, key, 1)
            assert {each["map" if path != "/maps" else "name"] for each in found} == {"wing"}, path
        assert client.get("/maps/wing").status_code == 200
        for name in ("barn", "office"):
            assert client.get(f"/maps/{name}").status_code == 404
        assert client.get(f"/tracks/{both.ids['office']['track']}").status_code == 404
        body = {"map": "wing", "name": "more", "concept": "Room"}
        made = client.post("/queries", json=body)
        assert made.status_code == 201, made.text
        assert client.delete(made.headers["location"]).status_code == 204
        assert client.post("/queries", json={**body, "map": "barn"}).status_code == 404
    with both.service.client("read") as client:
        assert client.post("/queries", json=body).status_code == 403


def test_states_go_to_the_shard_of_their_map(both: Campus) -> None:
    stamp = datetime(2026, 1, 31, 12, tzinfo=UTC).isoformat()
    state = {"track": "cat", "stamp": stamp, "x_m": 1.0, "y_m": 1.0}
    door = {"instance": "wing room", "property": "light", "value": "on", "stamp": stamp}
    with both.service.client("ingest") as client:
        taken = client.post("/maps/wing/states", json={"source": "cam", "states": [state]})
        assert (taken.status_code, taken.json()["accepted"]) == (200, 1), taken.text
        told = client.post("/object-states", json={"map": "wing", "source": "hand", "states": [door]})
        assert (told.status_code, told.json()) == (200, {"added": 1})
        assert [each["name"] for each in client.get("/tracks?name=cat").json()["tracks"]] == ["cat"]
        with connect_socket(
            both.service.socket_url("/maps/wing/live"),
            additional_headers={"Authorization": f"Bearer {both.service.tokens['read']}"},
        ) as live:
            assert "cat" in live.recv(timeout=30)


def test_a_map_is_made_imported_and_deleted_where_it_is_placed(both: Campus) -> None:
    place_map(both.directory, "flat", "north")
    file = {"file": ("flat.geojson", json.dumps(FLAT).encode())}
    with both.service.client("admin") as client:
        assert client.post("/maps/import", files=file).status_code == 201
        with connect(both.north) as owner:
            assert owner.execute("select name from semap.map where name = 'flat'").fetchall() == [("flat",)]
        assert client.post("/maps", json={"name": "flat"}).status_code == 409
        rule = {
            "map": "flat",
            "name": "visits",
            "declaration": {"input": "track_in_room", "emit": {"began": "in"}},
        }
        assert client.post("/rules", json=rule).status_code == 201
        assert client.delete("/maps/flat").status_code == 204
        assert client.get("/maps/flat").status_code == 404
        waiting = client.post("/maps/import", files=file, headers={"Prefer": "respond-async"})
        job = finished(client, waiting)
        assert (job["state"], job["result"]["map"]) == ("done", "flat"), job
        assert client.delete("/maps/flat").status_code == 204
        with one_transaction(both.directory, "semap_admin") as connection:
            drain_shard(connection, "main")
        try:
            file = {"file": ("hut.geojson", json.dumps(FLAT).encode())}
            waiting = client.post("/maps/import", files=file, headers={"Prefer": "respond-async"})
            job = finished(client, waiting)
            assert job["state"] == "done", job
            with connect(both.north) as owner:
                assert owner.execute("select from semap.map where name = 'hut'").rowcount == 1
            assert client.delete("/maps/hut").status_code == 204
        finally:
            with one_transaction(both.directory, "semap_admin") as connection:
                drain_shard(connection, "main", draining=False)
