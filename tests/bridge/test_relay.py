"""Rules apart from the database, over Kafka: the same events, row for row, as of one worker, whoever is killed."""

from __future__ import annotations

import json
from contextlib import closing
from functools import partial
from pathlib import Path
from threading import Event as Signal

import pytest
from door_scene import PAPER, DoorScene
from patience import until
from relaying import begin, counted, go_on, publishing, rows, running, running_relay
from rule_work import await_progress, running_worker
from semap_bridge.relay.collecting import Check, check, collecting
from semap_bridge.relay.deriving import Kept
from semap_bridge.relay.topics import Topics as RelayTopics
from topics import Topics
from world import World

from bench.kafka.broker import Broker
from semap.errors import Conflict, ServerUnavailable, ServiceUnreachable
from semap.store.database.connection import connect, own_session
from semap.store.event.collected import collect, offsets
from semap.worker.publishing import Publishing
from semap.worker.rule_worker import work


def test_rules_apart_make_what_one_worker_makes(
    database: str, other_database: str, relay: RelayTopics, tmp_path: Path
) -> None:
    """Rules that are under way are handed over when what runs them changes."""
    here, there = (DoorScene(World(dsn)) for dsn in (database, other_database))
    for scene in (here, there):
        with running_worker(scene.world.dsn):
            begin(scene)
            await_progress(scene.world.dsn)
    with connect(other_database) as connection:
        assert connection.execute("select count(*) > 0 from semap.rule_state").fetchone() == (True,)
    with running_worker(database):
        go_on(here)
        await_progress(database)
    expected = rows(database)
    for _ in range(2):
        with running_relay(other_database, relay, tmp_path / "state"):
            if _ == 0:
                go_on(there)
            until(lambda: counted(other_database) >= len(expected))
            await_progress(other_database)
    assert rows(other_database) == expected
    assert {row[0] for row in expected} >= {*PAPER, "stayed", "settled", "built", "looks_back"}
    with connect(other_database) as connection:
        numbers = connection.execute("select array_agg(seq order by seq) from semap.event").fetchone()
        assert numbers == (list(range(1, len(expected) + 1)),)
        assert connection.execute("select count(*) from semap.rule_state").fetchone() == (0,)
    for scene in (here, there):
        scene.world.close()


def test_each_may_be_killed_between_sending_and_noting_it(
    database: str, other_database: str, relay: RelayTopics, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Then it sends again; who reads passes it over. Each time another of the two notes is lost."""
    here, there = (DoorScene(World(dsn)) for dsn in (database, other_database))
    with running_worker(database):
        begin(here)
        go_on(here)
        await_progress(database)
    expected, lost = rows(database), {"publisher": 0, "rules": 0}
    commit, write = Publishing.commit, Kept.write

    def commit_or_die(self: Publishing, connection, before_lsn: int) -> int:
        if self._records and lost["publisher"] < 5:
            lost["publisher"] += 1
            self._send(self._records)
            raise ServerUnavailable("killed")
        return commit(self, connection, before_lsn)

    def write_or_die(self: Kept, changes, places) -> None:
        if changes and lost["rules"] < 5:
            lost["rules"] += 1
            raise ServiceUnreachable("killed")
        write(self, changes, places)

    monkeypatch.setattr(Publishing, "commit", commit_or_die)
    monkeypatch.setattr(Kept, "write", write_or_die)
    with running_relay(other_database, relay, tmp_path / "state"):
        begin(there)
        go_on(there)
        until(lambda: counted(other_database) >= len(expected))
        await_progress(other_database)
    assert rows(other_database) == expected
    assert lost == {"publisher": 5, "rules": 5}
    for scene in (here, there):
        scene.world.close()


def test_a_map_is_checked_by_taking_its_steps_once_more(
    database: str, relay: RelayTopics, tmp_path: Path, broker: Broker
) -> None:
    scene = DoorScene(World(database))
    with running_relay(database, relay, tmp_path / "state"):
        begin(scene)
        go_on(scene)
        until(lambda: counted(database) > 10)
        await_progress(database)
        uid = str(scene.world.one("select uid from semap.map"))
        until(lambda: check(relay, uid).missing == [])
    count = counted(database)
    assert check(relay, uid) == Check(count, [], [], [])
    first, second, *_ = (str(row[1]) for row in rows(database) if row[0] != "built")
    topics = Topics(broker, relay.events.removesuffix(".events"))
    said = [json.loads(each.value()) for each in topics.read(relay.events)]
    event = next(each for each in said if each.get("event", {}).get("event_id") == first)
    event["event"]["type"] = "forged"
    unknown = json.loads(json.dumps(event))
    unknown["event"]["event_id"] = second[:-4] + "ffff"
    topics.write(relay.events, [(uid, json.dumps(each).encode(), -1) for each in (event, unknown)])
    assert check(relay, uid) == Check(count - 1, [first], [], [unknown["event"]["event_id"]])
    scene.world.close()


def test_what_is_published_is_no_longer_worked_on_and_keeps_its_name(
    database: str, relay: RelayTopics
) -> None:
    scene = DoorScene(World(database))
    with running(partial(publishing, database, relay, "north")):
        begin(scene)
        await_progress(database)
    with pytest.raises(Conflict, match="published as north"):
        work(database, Signal())
    with pytest.raises(Conflict, match="published as north, not as south"):
        publishing(database, relay, "south", Signal())
    scene.world.close()


def test_of_two_collectors_one_goes_on(world: World) -> None:
    event = {
        "event_id": "00000000-0000-0000-0000-000000000001", "map_id": world.map_id, "rule_name": "r",
        "rule_version": 1, "type": "t", "stamp": "2026-01-31T12:00:00Z", "since": "2026-01-31T12:00:00Z",
        "evidence": [],
    }  # fmt: skip
    late = {
        "map_id": world.map_id, "uid": "u", "input": "door", "stamp": "2026-01-31T12:00:00Z",
        "watermark": "2026-01-31T12:00:00Z", "row": [],
    }  # fmt: skip
    with closing(own_session(world.dsn, "semap_worker")) as connection:
        assert collect(connection, "t", 2, (5, 8), [json.dumps(event)] * 2, [json.dumps(late)]) == 1
        with pytest.raises(ServerUnavailable, match="collected"):
            collect(connection, "t", 2, (5, 9), [json.dumps(event)], [])
        assert collect(connection, "t", 2, (8, 9), [json.dumps(event)], [json.dumps(late)]) == 0
        assert offsets(connection, "t") == {2: 9}
    assert world.one("select count(*) from semap.event") == 1
    assert world.one("select count(*) from semap.late_row") == 1


def test_what_is_of_another_shard_is_left_to_its_collector(world: World, relay: RelayTopics) -> None:
    sender = relay.sender(relay.events)
    said = {
        shard: {"map_uid": "m", "shard": shard, "event": {
            "event_id": f"00000000-0000-0000-0000-00000000000{number}", "map_id": world.map_id, "rule_name": shard,
            "rule_version": 1, "type": "t", "stamp": "2026-01-31T12:00:00Z", "since": "2026-01-31T12:00:00Z",
            "evidence": []}}
        for number, shard in enumerate(["north", "south"])
    }  # fmt: skip
    sender.send([("m", json.dumps(each)) for each in said.values()])
    with running(lambda stop: collecting(world.dsn, relay, "south", stop)):
        until(lambda: world.one("select count(*) from semap.event") == 1)
    assert world.one("select rule_name from semap.event") == "south"


def test_a_second_process_of_a_file_is_refused(tmp_path: Path) -> None:
    with closing(Kept(tmp_path / "state")), pytest.raises(Conflict, match="cannot be used"):
        Kept(tmp_path / "state")
