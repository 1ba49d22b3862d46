"""The graph of ROS 2: with a process that knows nothing of semap and rosbags, bytes are what they should be."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from patience import until
from robots import LOOPBACK, domain
from semap_bridge.adapters.ros.backlog import MOST, MOST_OF, Backlog
from semap_bridge.ros.dds import Dds, network_config
from semap_bridge.ros.graph import Heard, Offer
from semap_bridge.ros.message import messages

SCAN, STRING = "sensor_msgs/msg/LaserScan", "std_msgs/msg/String"


class Peer:
    """The other process."""

    def __init__(self, number: int) -> None:
        script = Path(__file__).with_name("cyclone_peer.py")
        self.process = subprocess.Popen(
            [sys.executable, str(script), str(number)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def ask(self, what: str = "") -> dict:
        into, out = self.process.stdin, self.process.stdout
        into.write(f"{what}\n".encode())
        into.flush()
        return json.loads(out.readline())

    def close(self) -> None:
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()


@pytest.fixture
def number() -> int:
    return domain()


@pytest.fixture
def peer(number: int) -> Iterator[Peer]:
    made = Peer(number)
    yield made
    made.close()


@pytest.fixture
def graph(number: int) -> Iterator[Dds]:
    made = Dds(number, "semap_robot", network_config(LOOPBACK, []))
    yield made
    made.close()


def seen(graph: Dds, topic: str) -> Offer:
    until(lambda: any(each.topic == topic for each in graph.offers()))
    return next(each for each in graph.offers() if each.topic == topic)


def test_a_scan_has_the_bytes_that_rosbags_writes(graph: Dds, peer: Peer) -> None:
    offer = seen(graph, "/scan")
    assert offer == Offer("/scan", SCAN, 1, is_reliable=False, is_latched=False)
    graph.hear([offer])
    until(lambda: peer.ask()["listeners"])
    peer.ask("scan")
    (heard,) = graph.take(10.0)
    m = messages(is_ros1=False)
    stamp = m.new("builtin_interfaces/msg/Time", sec=1_700_000_000, nanosec=5)
    scan = m.new(
        SCAN,
        header=m.new("std_msgs/msg/Header", stamp=stamp, frame_id="laser"),
        angle_min=-1.0,
        angle_max=1.0,
        angle_increment=0.25,
        scan_time=0.1,
        range_min=0.05,
        range_max=9.0,
        ranges=np.array([0.5 + i / 100 for i in range(7)], np.float32),
    )
    assert heard.raw == m.write(scan)
    assert (heard.topic, heard.type) == ("/scan", SCAN)


def test_a_latched_message_comes_to_who_comes_later_and_the_node_has_a_name(graph: Dds, number: int) -> None:
    m = messages(is_ros1=False)
    room = graph.publish("/semap/room", STRING, is_latched=True)
    for said in ("Hall", "Kitchen, 1. Stock: Küche"):
        room.send(m.write(m.new(STRING, data=said)))
    peer = Peer(number)
    told = {"nodes": [], "gids": [], "rooms": []}

    def hears() -> bool:
        for name, each in peer.ask().items():
            told.get(name, []).extend(each if isinstance(each, list) else [])
        return bool(told["nodes"] and told["rooms"])

    until(hears, lambda: str(told))
    peer.close()
    assert told["rooms"] == ["Kitchen, 1. Stock: Küche"]
    assert set(told["nodes"]) == {"semap_robot"}
    assert told["gids"][0] == graph.guid.hex()


def test_two_publishers_and_two_types_are_told_apart(graph: Dds, peer: Peer, number: int) -> None:
    seen(graph, "/scan")
    other = Dds(number, "second", network_config(LOOPBACK, []))
    other.publish("/scan", SCAN)
    until(lambda: seen(graph, "/scan").publishers == 2)
    assert seen(graph, "/scan").nodes == ("/second",)
    assert not seen(graph, "/scan").is_reliable, "both are heard"
    other.publish("/scan", STRING)
    until(lambda: {each.type for each in graph.offers() if each.topic == "/scan"} == {SCAN, STRING})
    other.close()
    until(lambda: seen(graph, "/scan").publishers == 1)


def test_a_reader_goes_on_where_a_weaker_publisher_comes(graph: Dds, number: int) -> None:
    other = Dds(number, "strong", network_config(LOOPBACK, []))
    m = messages(is_ros1=False)
    strong = other.publish("/scan", SCAN)
    graph.hear([seen(graph, "/scan")])
    peer = Peer(number)
    until(lambda: seen(graph, "/scan").publishers == 2)
    graph.hear([seen(graph, "/scan")])
    until(lambda: peer.ask()["listeners"] and strong.listeners())
    peer.ask("scan")
    strong.send(m.write(m.new(SCAN, range_max=2.0)))
    heard: list[bytes] = []
    until(lambda: len(heard) == 2 or (heard.extend(each.raw for each in graph.take(0.1)) or len(heard) == 2))
    peer.close()
    other.close()
    assert {m.read(each, SCAN).range_max for each in heard} == {2.0, 9.0}


def test_nothing_goes_before_it_is_taken(graph: Dds, number: int) -> None:
    m = messages(is_ros1=False)
    other = Dds(number, "quick", network_config(LOOPBACK, []))
    scans = other.publish("/scan", SCAN)
    graph.hear([seen(graph, "/scan")])
    until(scans.listeners)
    sent = [float(each) for each in range(900)]
    for each in sent:
        scans.send(m.write(m.new(SCAN, range_max=each)))
    heard: list[float] = []
    until(
        lambda: (
            heard.extend(m.read(each.raw, SCAN).range_max for each in graph.take(0.1)) or len(heard) == 900
        )
    )
    assert heard == sent
    assert graph.lost == 0
    other.close()


@given(topics=st.lists(st.sampled_from(["/image", "/scan", "/tf"]), max_size=400))
def test_what_waits_too_long_is_dropped_and_counted_by_topic(topics: list[str]) -> None:
    types = {"/image": "sensor_msgs/msg/Image", "/scan": SCAN, "/tf": "tf2_msgs/msg/TFMessage"}
    backlog = Backlog()
    sent = [Heard(topic, types[topic], "", b"", number) for number, topic in enumerate(topics)]
    dropped = sum(backlog.put(each) for each in sent)
    newest = [
        each
        for topic, kind in types.items()
        for each in [one for one in sent if one.topic == topic][-MOST_OF.get(kind, MOST) :]
    ]
    taken = [backlog.take(0.0) for _ in range(len(sent) - dropped)]
    assert taken == sorted(newest, key=lambda each: each.sent_us)
    assert backlog.take(0.0) is None


def test_a_publisher_that_leaves_is_no_message(graph: Dds, number: int) -> None:
    m = messages(is_ros1=False)
    for name in ("first", "second"):
        other = Dds(number, name, network_config(LOOPBACK, []))
        scans = other.publish("/scan", SCAN)
        graph.hear([seen(graph, "/scan")])
        until(scans.listeners)
        scans.send(m.write(m.new(SCAN, range_max=2.0)))
        assert len(graph.take(10.0)) == 1
        other.close()
        until(lambda: not graph.offers())
        assert graph.take(0.5) == []
