"""A house in Home Assistant: what is told by MQTT, and what Home Assistant itself makes of it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import shapely
from bridging import config, report, running
from mosquitto import Mosquitto, Peer, broker, needs_mosquitto, peer
from patience import until
from rule_work import running_worker
from semap_bridge.checking import check_bridge
from semap_bridge.config import Entry, read_config
from world import SECOND_US, World

pytestmark = needs_mosquitto
CHECKOUT = Path(__file__).parents[2]
PYTHON = Path(os.environ.get("SEMAP_HOME_ASSISTANT", CHECKOUT / ".home-assistant")) / "bin" / "python"
FIRST_US = 1_700_000_000 * SECOND_US


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[Mosquitto]:
    with broker(tmp_path) as made:
        yield made


@pytest.fixture
def house(world: World) -> World:
    """Two rooms, one of them with a name that no topic can have, and a door."""
    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    world.add_room("tea/coffee+", shapely.box(4, 0, 8, 4))
    door = world.add_room("front door", shapely.box(0, 0, 0.1, 1))
    world.run(
        "update semap.instance set concept_id = semap.concept_named('Door') where instance_id = %s", door
    )
    return world


def entry(folder: Path, port: int, **settings: object) -> Entry:
    given = {"broker": {"host": "127.0.0.1", "port": port}, "why_s": 0.1, **settings}
    written = "".join(f"    {name}: {json.dumps(value)}\n" for name, value in given.items())
    return read_config(config(folder, f"  - name: lines\n    kind: home_assistant\n{written}")).bridges[0]


def state_of(told: Peer, topic: str) -> object:
    return json.loads(told.retained.get(f"semap/world/{topic}", b"null"))


def configs(told: Peer) -> dict[str, dict]:
    """Documents by the names of their devices, or of the rule's event."""
    documents = [json.loads(value) for topic, value in told.retained.items() if topic.endswith("/config")]
    return {
        each["components"]["event"]["name"] if "event" in each["components"] else each["device"]["name"]: each
        for each in documents
    }


def test_rooms_people_and_doors_are_told_and_go_again(
    house: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    anna, mouse = house.add_track("anna"), house.add_track("mouse")
    with peer(mosquitto.port, "semap/#", "homeassistant/#") as told:
        one = entry(tmp_path, mosquitto.port, people=["a*"])
        with running(house, one):
            until(lambda: set(configs(told)) == {"kitchen", "tea/coffee+", "front door", "room_visits"})
            assert told.retained["semap/world/availability"] == b"online"
            until(lambda: state_of(told, "room/kitchen") == {"count": 0, "who": []})
            until(lambda: state_of(told, "door/front door") == {"state": "unknown", "since": None})
            house.add_states([(anna, FIRST_US, 1.0, 1.0, None), (mouse, FIRST_US, 2.0, 2.0, None)])
            until(lambda: state_of(told, "room/kitchen") == {"count": 2, "who": ["anna", "mouse"]})
            until(lambda: state_of(told, "person/anna") == {"state": "kitchen", "room": "kitchen"})
            assert "mouse" not in configs(told)
            house.add_states([(anna, FIRST_US + SECOND_US, 5.0, 1.0, None)])
            until(lambda: state_of(told, "room/tea%2Fcoffee%2B") == {"count": 1, "who": ["anna"]})
            house.add_states([(anna, FIRST_US + 2 * SECOND_US, 20.0, 1.0, None)])
            until(lambda: state_of(told, "person/anna") == {"state": "no room", "room": None})
            house.end_track(anna, FIRST_US + 3 * SECOND_US)
            until(lambda: state_of(told, "person/anna") == {"state": "away"})
            assert "anna" in configs(told)
        until(lambda: told.retained["semap/world/availability"] == b"offline")
        house.delete_room("kitchen")
        house.run("delete from semap.track where name = 'anna'")
        house.run("update semap.rule set enabled = false")
        with running(house, one):
            until(lambda: set(configs(told)) == {"tea/coffee+", "front door"})
            until(lambda: state_of(told, "room/kitchen") is None)
            until(lambda: state_of(told, "person/anna") is None)


def test_events_and_why_there_were_none(house: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    anna = house.add_track("anna")
    long_stay = {
        "input": "track_in_room", "partition_by": ["track"], "pattern": "E L", "within": "1 s",
        "define": {"E": "type = 'began'", "L": "type = 'ended'"}, "emit": "quick",
    }  # fmt: skip
    house.run(
        "insert into semap.rule (map_id, name, queries, declaration)"
        " values (%s, 'quick', jsonb_build_object('track_in_room', %s::int), %s)",
        house.map_id, house.query_id, json.dumps(long_stay),
    )  # fmt: skip
    with (
        peer(mosquitto.port, "semap/#", "homeassistant/#") as told,
        running_worker(house.dsn),
        running(house, entry(tmp_path, mosquitto.port)),
    ):
        until(lambda: "quick" in configs(told))
        assert configs(told)["room_visits"]["components"]["event"]["event_types"] == ["entered", "left"]
        house.add_states(
            [(anna, FIRST_US + i * SECOND_US, x, 1.0, None) for i, x in enumerate([1.0, 2.0, 20.0, 21.0])]
        )
        events = []

        def has_left() -> bool:
            while not told.heard.empty():
                message = told.heard.get()
                if message.topic == "semap/world/rule/room_visits":
                    assert not message.retain
                    events.append(json.loads(message.payload))
            return len(events) == 2

        until(has_left)
        assert [(each["event_type"], each["track"], each["instance"]) for each in events] == [
            ("entered", "anna", "kitchen"), ("left", "anna", "kitchen"),
        ]  # fmt: skip
        assert events[0]["id"] == str(house.one("select event_id from semap.event where seq = 1"))
        until(lambda: (state_of(told, "why/quick") or {}).get("state") == "not fired")
        why = state_of(told, "why/quick")
        assert why["key"] == {"track": "anna"}
        assert any("window ended" in each for each in why["why"])
        until(lambda: (state_of(told, "why/room_visits") or {}).get("state") == "fired")


def test_old_events_are_left_out(house: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    made = (
        "insert into semap.event (seq, event_id, map_id, type, stamp, rule_version, rule_name, since, created_at)"
        " values (%s, gen_random_uuid(), %s, 'entered', now(), 1, 'room_visits', now(), now() - %s::interval)"
    )
    house.run(made, 1, house.map_id, "1 day")
    house.run(made, 2, house.map_id, "0")
    with (
        peer(mosquitto.port, "semap/world/rule/#") as told,
        running(house, entry(tmp_path, mosquitto.port, from_start=True)),
    ):
        said = json.loads(told.heard.get(timeout=60).payload)
        assert said["id"] == str(house.one("select event_id from semap.event where seq = 2"))
        assert told.heard.empty()
        until(lambda: report(house)["refusals"] == {"event too late": 1})


def test_all_is_said_again_when_home_assistant_starts(
    house: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    with (
        peer(mosquitto.port, "homeassistant/device/#", "semap/#") as told,
        running(house, entry(tmp_path, mosquitto.port)),
    ):
        until(lambda: len(configs(told)) == 4)
        until(lambda: state_of(told, "room/kitchen") is not None)
        while not told.heard.empty():
            told.heard.get()
        told.say("homeassistant/status", "online")
        again = set()
        wanted = {
            topic
            for topic in told.retained
            if topic.endswith("/config") or "/room/" in topic or "/door/" in topic
        }

        def is_all() -> bool:
            while not told.heard.empty():
                again.add(told.heard.get().topic)
            return wanted <= again

        until(is_all, lambda: wanted - again)


def test_the_last_will_says_that_the_bridge_is_away(
    house: World, tmp_path: Path, mosquitto: Mosquitto
) -> None:
    """As after kill -9: the process is gone, and said nothing."""
    entry(tmp_path, mosquitto.port)
    command = [
        shutil.which("semap", path=str(CHECKOUT / ".venv/bin")) or "semap",
        "bridge",
        str(tmp_path / "bridges.yaml"),
    ]
    with peer(mosquitto.port, "semap/#") as told:
        process = subprocess.Popen(
            command, env={**os.environ, "SEMAP_DSN": house.dsn}, stderr=subprocess.DEVNULL
        )
        try:
            until(lambda: told.retained.get("semap/world/availability") == b"online")
        finally:
            process.kill()
            process.wait()
        until(lambda: told.retained.get("semap/world/availability") == b"offline")


def test_check_writes_nothing(house: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    with peer(mosquitto.port, "#") as told:
        seen = check_bridge(house.dsn, entry(tmp_path, mosquitto.port), 0.5)
        told.say("end", "end")
        assert told.heard.get(timeout=60).topic == "end"
    assert [each.what for each in seen] == [f"127.0.0.1:{mosquitto.port}", "2 rooms", "1 doors", "1 rules"]
    assert not any(each.trouble for each in seen)


@contextmanager
def home_assistant(port: int, folder: Path) -> Iterator[HomeAssistant]:
    folder.mkdir()
    process = subprocess.Popen(
        [PYTHON, Path(__file__).parent / "home_assistant_core.py", str(port), str(folder)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert process.stdout.readline()
        yield HomeAssistant(process)
    finally:
        process.stdin.close()
        process.wait(60)
        process.stdout.close()


class HomeAssistant:
    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process

    def ask(self) -> dict:
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def state(self, entity: str) -> object:
        return self.ask()["states"].get(entity, {}).get("state")


@pytest.mark.skipif(not PYTHON.exists(), reason="there is no Home Assistant: ./dev home-assistant")
def test_home_assistant_itself_understands_it(house: World, tmp_path: Path, mosquitto: Mosquitto) -> None:
    anna = house.add_track("anna")
    one = entry(tmp_path, mosquitto.port)
    with home_assistant(mosquitto.port, tmp_path / "home") as home, running_worker(house.dsn):
        with running(house, one):
            until(lambda: home.state("binary_sensor.kitchen_occupancy") == "off", home.ask)
            house.add_states([(anna, FIRST_US, 1.0, 1.0, None)])
            house.run(
                "insert into semap.object_state (source_id, instance_name, property, value, stamp)"
                " values (%s, 'front door', 'door', 'open', now())", house.source_id,
            )  # fmt: skip
            wanted = {
                "binary_sensor.kitchen_occupancy": "on", "sensor.kitchen_occupants": "1", "sensor.kitchen_who": "anna",
                "binary_sensor.tea_coffee_occupancy": "off", "sensor.tea_coffee_who": "nobody",
                "sensor.anna_room": "kitchen", "binary_sensor.front_door": "on",
                "sensor.semap_world_room_visits_why": "fired",
            }  # fmt: skip
            for entity, state in wanted.items():
                until(lambda entity=entity, state=state: home.state(entity) == state, home.ask)
            until(
                lambda: home.ask()["states"]["event.semap_world_room_visits"].get("event_type") == "entered",
                home.ask,
            )
            told = home.ask()
            assert told["states"]["event.semap_world_room_visits"]["track"] == "anna"
            assert told["states"]["sensor.kitchen_who"]["who"] == ["anna"]
            assert told["states"]["sensor.semap_world_room_visits_why"]["why"]
            house.delete_room("tea/coffee+")
            until(lambda: "tea/coffee+" not in home.ask()["devices"], home.ask)
        until(lambda: home.state("binary_sensor.kitchen_occupancy") == "unavailable", home.ask)
        assert home.ask()["warnings"] == []
