"""One feed of two shards: the events of one worker on one database, row for row, whoever gathers and however often."""

from __future__ import annotations

import pytest
from access.guarded import Guarded
from bridge.relaying import begin, counted, go_on, rows
from door_scene import PAPER, DoorScene
from patience import until
from rule_work import await_progress, running_worker
from shard.serving import Campus, campus
from world import World

from semap.store.database.connection import connect, one_transaction
from semap.store.event.events import list_events
from semap.store.map.maps import delete_map
from semap.store.operate.shards import place_map
from semap.worker import gathering as gathering_module
from semap.worker.gathering import gathering


def places(dsn: str) -> dict:
    with one_transaction(dsn, "semap_read") as connection:
        return {
            each.event_id: each.place
            for each in list_events(connection, limit=10_000)
            if each.rule != "built"
        }


def of_map(dsn: str, map_id: int) -> int:
    with connect(dsn) as connection:
        (count,) = connection.execute(
            "select count(*) from semap.event where map_id = %s", [map_id]
        ).fetchone()
        return count


def test_two_shards_make_what_one_database_makes(database: str, north: str, other_database: str) -> None:
    place_map(database, "there", "north")
    together = [DoorScene(World(other_database, name)) for name in ("here", "there")]
    apart = [DoorScene(World(database, "here")), DoorScene(World(north, "there"))]
    with running_worker(other_database):
        for play in (begin, go_on):
            for scene in together:
                play(scene)
        await_progress(other_database)
    expected = rows(other_database)
    with running_worker(database), running_worker(north):
        with gathering(database):
            for scene in apart:
                begin(scene)
            until(lambda: of_map(database, apart[1].world.map_id) > 0)
        for scene in apart:  # while nobody gathers
            go_on(scene)
        await_progress(north)
        await_progress(database)
        with gathering(database), gathering(database):  # of two, one does
            until(lambda: counted(database) >= len(expected))
    assert rows(database) == expected
    assert {row[0] for row in expected} >= {*PAPER, "stayed", "settled", "built", "looks_back"}
    assert places(database) == places(other_database)
    with connect(database) as connection:
        (numbers,) = connection.execute("select array_agg(seq order by seq) from semap.event").fetchone()
    assert numbers == list(range(1, len(expected) + 1))
    for scene in (*together, *apart):
        scene.world.close()


@pytest.fixture
def both(database: str, north: str):
    with campus(database, north) as made, gathering(database):
        until(lambda: counted(database) == 4)
        yield made


def feed(service: Guarded, token: str, **wanted: object) -> list[dict]:
    with service.client(token) as client:
        found, after = [], 0
        while True:
            page = client.get("/events", params={"after": after, "limit": 1, **wanted}).json()
            if not page["events"]:
                return found
            found += page["events"]
            after = page["next"]


def test_the_feed_has_all_maps_with_one_cursor(both: Campus) -> None:
    found = feed(both.service, "read")
    assert [each["seq"] for each in found] == [1, 2, 3, 4]
    assert sorted(each["map"] for each in found) == ["annex", "barn", "office", "wing"]
    by_map = {each["map"]: each["seq"] for each in found}
    assert [each["seq"] for each in feed(both.service, "read", map="wing")] == [by_map["wing"]]
    near = feed(both.service, "read", filter="S_INTERSECTS(place, POINT(1 2))")
    assert sorted(each["map"] for each in near) == ["annex", "barn", "office", "wing"]
    with both.service.client("read") as client:
        searched = client.get("/maps/wing/events").json()["events"]
        assert [each["seq"] for each in searched] == [by_map["wing"]]
        with client.stream("GET", "/events/stream", params={"after": 0}) as stream:
            ids = (line[4:] for line in stream.iter_lines() if line.startswith("id: "))
            assert [next(ids) for _ in range(5)] == ["0", "1", "2", "3", "4"]


def test_a_token_of_one_map_follows_its_numbers_alone(both: Campus) -> None:
    assert [(each["map"], each["seq"]) for each in feed(both.service, "wing", map="wing")] == [("wing", 1)]


def test_with_a_map_go_the_events_that_were_gathered(both: Campus) -> None:
    with both.service.client("admin") as client:
        assert client.delete("/maps/wing").status_code == 204
    assert sorted(each["map"] for each in feed(both.service, "read")) == ["annex", "barn", "office"]
    with connect(both.directory) as owner:
        assert owner.execute("select name from semap.place order by name").fetchall() == [
            ("annex",),
            ("barn",),
            ("office",),
        ]


def test_a_map_that_went_without_a_word_is_forgotten(both: Campus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gathering_module, "FORGET_S", 0.0)
    with one_transaction(both.north, "semap_api") as connection:
        delete_map(connection, "barn")
    until(lambda: counted(both.directory) == 3)
    place_map(both.directory, "barn", "main")


def test_a_shard_that_is_away_is_awaited_and_hides_no_other(both: Campus) -> None:
    with connect(both.directory) as owner:
        owner.execute("update semap.shard set dsn = dsn || '_gone' where dsn is not null")
    with both.service.client("read") as client:
        until(lambda: client.get("/maps").status_code == 503)
        assert client.get("/maps/office").status_code == 200
        assert len(feed(both.service, "read")) == 4
        with connect(both.directory) as owner:
            owner.execute("update semap.shard set dsn = replace(dsn, '_gone', '') where dsn is not null")
        until(lambda: client.get("/maps").status_code == 200)
