"""Robots for tests: a laser in a room that is published over DDS or by rospy, and recordings that are played."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import numpy as np
from bridging import config
from patience import until
from semap_bridge.config import Entry, read_config
from semap_bridge.ros.graph import Graph, Heard
from semap_bridge.ros.message import messages

from semap.store.database.connection import connect

LOOPBACK = "127.0.0.1"
SCAN, TF, STRING = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage", "std_msgs/msg/String"
FIRST_US = 1_700_000_000_000_000
STEP_US = 100_000
_numbers = count()


def domain() -> int:
    """One that no other test of this run has; workers of pytest are processes of their own."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
    return 20 + worker * 50 % 180 + next(_numbers) % 50


def ros_entry(folder: Path, map_name: str = "office", kind: str = "ros2", **settings: object) -> Entry:
    """The one bridge of a config, `robot`, with these settings."""
    if kind == "ros2":
        settings = {"interface": LOOPBACK, **settings}
    written = "".join(f"    {name}: {json.dumps(value)}\n" for name, value in settings.items())
    return read_config(config(folder, f"  - name: robot\n    kind: {kind}\n{written}", map_name)).bridges[0]


def told(dsn: str) -> dict:
    """What the bridge `robot` said of itself."""
    with connect(dsn) as connection:
        row = connection.execute("select to_jsonb(b) from semap.bridge b where name = 'robot'").fetchone()
    return row[0] if row else {"refusals": {}, "trouble": "", "state": "", "received": 0, "committed": 0}


def rows(dsn: str, statement: str, *parameters: object) -> list[tuple]:
    with connect(dsn) as connection:
        return connection.execute(statement, parameters).fetchall()


def marks(dsn: str) -> dict[str, int]:
    """How far each source of the bridge is [us]."""
    return dict(
        rows(
            dsn,
            "select s.name, (extract(epoch from s.watermark) * 1000000)::bigint from semap.source s join semap.map m"
            " using (map_id) where m.name in ('office', 'world') and watermark > '-infinity'",
        )
    )


class Robot:
    """A laser at the map's origin, one metre before a wall, and its transforms."""

    def __init__(self, graph: Graph, topic: str = "/scan") -> None:
        self.graph, self.m = graph, messages(is_ros1=graph.is_ros1)
        self.scans = graph.publish(topic, SCAN)
        self.moving = graph.publish("/tf", TF)
        self.fixed = graph.publish("/tf_static", TF, is_latched=True)
        self.stamp_us = FIRST_US

    def fix(self, *edges: tuple[str, str]) -> None:
        """Frames that are where their parents are."""
        self.fixed.send(
            self.m.write(self.m.new(TF, transforms=[self._edge(*each, self.stamp_us) for each in edges]))
        )

    def move(self, parent: str, child: str, stamp_us: int, x_m: float = 0.0) -> None:
        self.moving.send(
            self.m.write(self.m.new(TF, transforms=[self._edge(parent, child, stamp_us, x_m)])), self.stamp_us
        )

    def scan(
        self, *, beams: int = 181, stamp_us: int | None = None, frame: str = "laser", **more: object
    ) -> None:
        """One sweep of 180 degrees, a step of time after the last one."""
        self.stamp_us += STEP_US
        angle = np.linspace(-math.pi / 2, math.pi / 2, beams)
        ranges = np.minimum(1.0 / np.maximum(np.cos(angle), 1e-3), 8.0).astype(np.float32)
        header = self.m.header(self.stamp_us if stamp_us is None else stamp_us, frame)
        fields = {
            "angle_min": -math.pi / 2, "angle_increment": math.pi / (beams - 1), "range_min": 0.05, "range_max": 9.0,
            "ranges": ranges, **more,
        }  # fmt: skip
        self.scans.send(self.m.write(self.m.new(SCAN, header=header, **fields)))

    def _edge(self, parent: str, child: str, stamp_us: int, x_m: float = 0.0) -> object:
        place = self.m.new("geometry_msgs/msg/Vector3", x=x_m)
        turn = self.m.new("geometry_msgs/msg/Quaternion", w=1.0)
        return self.m.new(
            "geometry_msgs/msg/TransformStamped",
            header=self.m.header(stamp_us, parent),
            child_frame_id=child,
            transform=self.m.new("geometry_msgs/msg/Transform", translation=place, rotation=turn),
        )


def scanning(robot: Robot, happens: Callable[[], object], **scan: object) -> None:
    """Scan until something happens."""

    def again() -> object:
        robot.scan(**scan)
        return happens()

    until(again)


def hearing(graph: Graph, topic: str, happens: Callable[[list[object]], object]) -> list[object]:
    """Messages of a topic, until these are those that were waited for."""
    m = messages(is_ros1=graph.is_ros1)
    heard: list[object] = []

    def offered() -> list:
        return [each for each in graph.offers() if each.topic == topic]

    until(offered)
    graph.hear(offered())

    def more() -> object:
        for each in graph.take(0.1):
            assert isinstance(each, Heard)
            heard.append(m.read(each.raw, each.type))
        return happens(heard)

    until(more, lambda: f"{len(heard)} on {topic}")
    return heard


@contextmanager
def closing(graph: Graph) -> Iterator[Graph]:
    try:
        yield graph
    finally:
        graph.close()
