"""Plays a recording into a graph, byte by byte and in its own time, as the robot that made it."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event as Signal

from semap_ingest.pipeline.pace import Pace
from semap_ingest.recording.rosbag_file import RosbagFile

from semap_bridge.ros.graph import Graph
from semap_bridge.ros.message import MALFORMED, messages

LATCHED = "tf_static"
STILL_S = 0.5
"""Who listens is there when nobody more has come for so long."""
LOOK_S = 0.05


def play(
    path: Path,
    graph: Graph,
    stop: Signal,
    *,
    speed: float = 1.0,
    wait_s: float = 10.0,
    waits: Callable[[], None] = lambda: None,
) -> int:
    """How many messages were sent.

    wait_s  for somebody who listens; then it is played to nobody
    waits   called where nobody listens at first
    raises  InvalidInput for what is no recording
    """
    recording = RosbagFile(path)
    try:
        convert = _conversion(recording.is_ros1, graph.is_ros1)
        known = [each for each in recording.connections if graph.knows(each.msgtype)]
        publishers = {
            each.id: graph.publish(
                each.topic, each.msgtype, is_latched=each.topic.rpartition("/")[2] == LATCHED
            )
            for each in known
        }
        types = {each.id: each.msgtype for each in known}
        _await(lambda: sum(each.listeners() for each in publishers.values()), wait_s, stop, waits)
        pace = Pace(speed)
        sent = 0
        for connection_id, log_ns, raw in recording.messages(known):
            pace.wait(log_ns // 1000, stop)
            if stop.is_set():
                break
            with suppress(*MALFORMED):
                publishers[connection_id].send(convert(raw, types[connection_id]), log_ns // 1000)
                sent += 1
        return sent
    finally:
        recording.close()


def _await(listeners: Callable[[], int], wait_s: float, stop: Signal, waits: Callable[[], None]) -> None:
    begun_s = still_s = time.monotonic()
    before = 0
    while not stop.is_set():
        now, now_s = listeners(), time.monotonic()
        if now != before:
            before, still_s = now, now_s
        if (now and now_s - still_s > STILL_S) or now_s - begun_s > wait_s:
            return
        if not now and still_s == begun_s:
            waits()
            still_s += 1e-9
        stop.wait(LOOK_S)


def _conversion(is_from_ros1: bool, is_to_ros1: bool) -> Callable[[bytes, str], bytes]:
    """From the bytes of one kind of ROS to those of the other."""
    store = messages(is_ros1=False).store
    if is_from_ros1 and not is_to_ros1:
        return lambda raw, name: bytes(store.ros1_to_cdr(raw, name))
    if is_to_ros1 and not is_from_ros1:
        return lambda raw, name: bytes(store.cdr_to_ros1(raw, name))
    return lambda raw, name: raw
