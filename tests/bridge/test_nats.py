"""Events to a stream of NATS JetStream: each once, within the window of message ids and beyond it."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest
import shapely
import yaml
from bridging import config, report, running
from making import make_events
from nats.js import JetStreamContext
from nats_server import Server, serving
from patience import until
from semap_bridge.checking import check_bridge
from semap_bridge.config import Entry, read_config
from world import SECOND_US, World

from semap.errors import Conflict, InvalidInput


def entry(folder: Path, server: Server, **settings: object) -> Entry:
    said = {"name": "lines", "kind": "nats", "servers": server.url, **settings}
    return read_config(config(folder, yaml.safe_dump([said]))).bridges[0]


def test_events_and_changes_are_published_once_in_their_order(world: World, tmp_path: Path) -> None:
    world.add_room("kitchen", shapely.box(0, 0, 4, 4))
    track_id = world.add_track("cat")
    with serving(tmp_path) as server:
        one = entry(tmp_path, server, events="semap.events", changes="semap.changes", from_start=True)
        made: list[str] = []
        for number in range(3):
            with running(world, one):
                made += make_events(world, 20)
                x_m = 1.0 if number % 2 == 0 else 9.0
                world.add_states([(track_id, number * SECOND_US, x_m, 1.0, 1.0)])
                count = len(made)
                until(lambda count=count: len(server.messages("semap.events")) >= count)
                until(lambda number=number: len(server.messages("semap.changes")) > number)
        assert [each["id"] for each in server.messages("semap.events")] == made
        assert [each["type"] for each in server.messages("semap.changes")] == [
            "semap.relation.began", "semap.relation.ended", "semap.relation.began"
        ]  # fmt: skip


@pytest.mark.parametrize("window_s", [120, 0.1], ids=["within the window", "beyond it"])
def test_what_was_sent_and_not_noted_is_not_there_twice(
    world: World, tmp_path: Path, window_s: float
) -> None:
    """As when a bridge is killed after the server has its messages, and before the database has the cursor."""
    with serving(tmp_path) as server:
        server.ask(lambda stream: stream.add_stream(name="semap", subjects=["e"], duplicate_window=window_s))
        one = entry(tmp_path, server, events="e", from_start=True)
        made: list[str] = []
        for kept in (0, 7, 13):
            made += make_events(world, 10)
            with running(world, one):
                until(lambda: len(server.messages("e")) == len(made))  # noqa: B023
            world.run(
                "update semap.bridge_position set position = jsonb_build_object('event', %s::int)", kept
            )
            if window_s < 1:
                server.stop()  # forgets which ids it has seen
                server.start()
        with running(world, one):
            made += make_events(world, 1)
            until(lambda: server.messages("e")[-1]["id"] == made[-1])
        assert [each["id"] for each in server.messages("e")] == made


def test_a_server_that_is_away_is_waited_for(world: World, tmp_path: Path) -> None:
    with serving(tmp_path) as server:
        with running(world, entry(tmp_path, server, events="e", from_start=True)):
            made = make_events(world, 5)
            until(lambda: len(server.messages("e")) == 5)
            server.stop()
            made += make_events(world, 5)
            until(lambda: report(world)["state"] == "waiting")
            assert "NATS at" in report(world)["trouble"]
            server.start()
            until(lambda: len(server.messages("e")) == 10)
        assert [each["id"] for each in server.messages("e")] == made


def test_a_stream_that_is_full_is_waited_for(world: World, tmp_path: Path) -> None:
    with serving(tmp_path) as server:
        limits = {"name": "semap", "subjects": ["e"], "discard": "new"}
        server.ask(lambda stream: stream.add_stream(max_msgs=3, **limits))
        with running(world, entry(tmp_path, server, events="e", from_start=True)):
            made = make_events(world, 8)
            until(lambda: "maximum messages" in str(report(world)["trouble"]))
            assert len(server.messages("e")) == 3
            server.ask(lambda stream: stream.update_stream(max_msgs=100, **limits))
            until(lambda: len(server.messages("e")) == 8)
        assert [each["id"] for each in server.messages("e")] == made


def test_a_subject_of_somebody_else_is_left_alone(world: World, tmp_path: Path) -> None:
    with serving(tmp_path) as server:

        async def write(stream: JetStreamContext) -> None:
            await stream.add_stream(name="theirs", subjects=["e"])
            await stream.publish("e", b"hello")

        server.ask(write)
        with running(world, entry(tmp_path, server, events="e", from_start=True)):
            make_events(world, 1)
            until(lambda: "not of the map world" in str(report(world)["trouble"]))
        assert server.ask(lambda stream: stream.stream_info("theirs")).state.messages == 1


def test_events_of_another_database_are_not_taken_for_ours(world: World, tmp_path: Path) -> None:
    with serving(tmp_path) as server:
        one = entry(tmp_path, server, events="e", from_start=True)
        with running(world, one):
            make_events(world, 5)
            until(lambda: len(server.messages("e")) == 5)
        world.run("delete from semap.event")
        world.run("delete from semap.bridge_position")
        told = pytest.raises(Conflict, match="up to number 5, and this database up to 2")
        with told, running(world, one) as thread:
            make_events(world, 2)
            until(lambda: not thread.is_alive())
        assert len(server.messages("e")) == 5


def test_a_password_is_of_a_file_read_again_and_in_no_log(
    world: World, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    secret, wrong = "hush-1234", "stale-9876"
    who = f'authorization {{ user: "semap", password: "{secret}" }}'
    with serving(tmp_path, who, user="semap", password=secret) as server:
        (tmp_path / "password").write_text(wrong)
        login = {"user": "semap", "password_file": "password"}
        with running(world, entry(tmp_path, server, events="e", login=login, from_start=True)):
            make_events(world, 1)
            until(lambda: "uthorization" in str(report(world)["trouble"]))
            (tmp_path / "password").write_text(f"{secret}\n")
            until(lambda: len(server.messages("e")) == 1)
    said = caplog.text + json.dumps(report(world))
    assert secret not in said
    assert wrong not in said


def test_a_check_says_what_is_there_and_makes_nothing(world: World, tmp_path: Path) -> None:
    with serving(tmp_path) as server:
        one = entry(tmp_path, server, events="e", changes="c")
        assert [(each.what, each.is_a) for each in check_bridge(world.dsn, one, 0.1)] == [
            ("e", "subject of events; the stream semap will be made"),
            ("c", "subject of changes; the stream semap will be made"),
        ]
        assert server.ask(lambda stream: stream.streams_info()) == []
    (sight,) = check_bridge(world.dsn, one, 0.1)
    assert "NATS at" in sight.trouble
    assert "nats-server -js" in sight.remedy


@pytest.mark.parametrize(
    ("settings", "said"),
    [({}, "events or changes"), ({"events": "a.*"}, "events"), ({"events": "a", "changes": "a"}, "a subject each"),
     ({"events": "a", "servers": "nats://u:p@h:1"}, "servers")],
)  # fmt: skip
def test_settings_that_cannot_be_meant_are_refused(
    tmp_path: Path, settings: dict[str, str], said: str
) -> None:
    with pytest.raises(InvalidInput) as refused:
        entry(tmp_path, Server(tmp_path), **settings)
    assert said in f"{refused.value} {refused.value.remedy}"
    assert ":p@" not in str(refused.value)
