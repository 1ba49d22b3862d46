"""From the publishing of a LaserScan to the door's event at a WebSocket client, over DDS on this machine.

The simulated office is published in its own time by this process; the bridge, the rule worker and the service
are processes of semap. The clock of an event starts when the scan of its stamp was published. Where the time
goes is told by the clocks on the way: a scan waits until tf covers its stamp (`tf`), is perceived and stored
(`bridge`), an event is made of it (`worker`), and comes to the client (`feed`).
"""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from pathlib import Path
from statistics import median
from threading import Event as Signal
from threading import Thread

import numpy as np
import websockets
from semap_bridge.adapters.ros.playing import play
from semap_bridge.adapters.ros.settings import Ros2Settings
from semap_bridge.ros.graph import Graph, Publisher
from semap_bridge.ros.message import messages
from semap_ingest.simulation.office import write_office
from semap_ingest.simulation.settings import OfficeSettings
from semap_service.evaluation.delays import DOOR_EVENTS
from semap_service.evaluation.play import set_the_stage
from semap_service.processes.port import free_port
from semap_service.processes.supervisor import Supervisor

from bench.figure import Rows, figure, once
from bench.latency import await_service
from semap.store.database.connection import connect
from semap.timeline.stamp import parse_stamp, to_us

DOMAIN = 94
SEEDS = (1, 2)
"""Each a round: another course of the office, with some 24 events of doors."""
CONFIG = """
map: office
bridges:
  - {{name: robot, kind: ros2, domain: {domain}, interface: 127.0.0.1, robot: base_link}}
"""
SCAN, TF = "/scan", "/tf"
FOUND = """
    select o.stamp, o.received_at, e.created_at from semap.object_state o
    join semap.event e on e.instance_id = o.instance_id and e.stamp = o.stamp
    where e.type = any (%s)
"""


def measure(dsn: str, seeds: tuple[int, ...] = SEEDS, duration_s: float = 93.0) -> Rows:
    """One row; a round is a course of the office."""
    delays: list[list[float]] = []
    parts: dict[str, list[float]] = {"tf": [], "bridge": [], "worker": [], "feed": []}
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            paths = write_office(
                Path(folder) / "office", OfficeSettings(seed=seed, duration_s=duration_s, camera=False)
            )
            set_the_stage(dsn, paths.map, "office")
            sent, received = _round(dsn, Path(folder), paths.recording)
        with connect(dsn) as connection:
            stored = {
                to_us(stamp): (to_us(kept), to_us(made))
                for stamp, kept, made in connection.execute(FOUND, [list(DOOR_EVENTS)]).fetchall()
            }
        for stamp_us, at_us in received:
            scan_us, tf_us = sent.of(stamp_us)
            kept_us, made_us = stored[stamp_us]
            known_us = max(scan_us, tf_us)
            for part, us in (
                ("tf", known_us - scan_us), ("bridge", kept_us - known_us), ("worker", made_us - kept_us),
                ("feed", at_us - made_us),
            ):  # fmt: skip
                parts[part].append(us / 1e3)
        delays.append([(at_us - sent.of(stamp_us)[0]) / 1e3 for stamp_us, at_us in received])
    return [
        {
            "events": sum(map(len, delays)),
            "p50_ms": figure((float(np.percentile(each, 50)) for each in delays), 1),
            "p99_ms": figure((float(np.percentile(each, 99)) for each in delays), 1),
            **{f"{part}_ms": once(median(values), 1) for part, values in parts.items()},
        }
    ]


class _Sent:
    """Mutable: when each scan was published, and from when on tf covered which stamps [us since 1970]."""

    def __init__(self) -> None:
        self.scans: dict[int, int] = {}
        self.tf: list[tuple[int, int]] = []

    def of(self, stamp_us: int) -> tuple[int, int]:
        """When the scan of a stamp was published, and the transform that was the first not before it."""
        return self.scans[stamp_us], next(at_us for covers_us, at_us in self.tf if covers_us >= stamp_us)


class _Noted(Publisher):
    def __init__(self, publisher: Publisher, topic: str, sent: _Sent) -> None:
        self._publisher, self._topic, self._sent = publisher, topic, sent
        self._messages = messages(is_ros1=False)

    def send(self, raw: bytes, sent_us: int | None = None) -> None:
        self._publisher.send(raw, sent_us)
        now_us = time.time_ns() // 1000
        if self._topic == SCAN:
            scan = self._messages.read(raw, "sensor_msgs/msg/LaserScan")
            self._sent.scans[_us(scan.header.stamp)] = now_us
        elif self._topic == TF:
            moved = self._messages.read(raw, "tf2_msgs/msg/TFMessage")
            self._sent.tf.append((min(_us(each.header.stamp) for each in moved.transforms), now_us))

    def listeners(self) -> int:
        return self._publisher.listeners()


def _us(stamp: object) -> int:
    return int(stamp.sec) * 1_000_000 + int(stamp.nanosec) // 1000  # type: ignore[attr-defined]


def _round(dsn: str, folder: Path, recording: Path) -> tuple[_Sent, list[tuple[int, int]]]:
    config = folder / "robot.yaml"
    config.write_text(CONFIG.format(domain=DOMAIN))
    port, sent = free_port(), _Sent()
    settings = Ros2Settings(name="player", kind="ros2", domain=DOMAIN, interface="127.0.0.1")
    graph = settings.graph("player")
    publish = graph.publish
    graph.publish = lambda topic, *given, **named: _Noted(publish(topic, *given, **named), topic, sent)  # type: ignore[method-assign]
    with Supervisor(dsn) as supervisor:
        supervisor.start("work")
        supervisor.start("serve", "--port", str(port), "--without-tokens")
        supervisor.start("bridge", "run", str(config), "--log-level", "warning", may_end=True)
        await_service(port)
        received = asyncio.run(_listen(port, graph, recording))
    graph.close()
    return sent, received


async def _listen(port: int, graph: Graph, recording: Path) -> list[tuple[int, int]]:
    """Stamp of every event of a door, and when it was here [us since 1970]."""
    received: list[tuple[int, int]] = []
    async with websockets.connect(f"ws://127.0.0.1:{port}/events/feed?map=office") as socket:
        assert json.loads(await socket.recv())["type"] == "hello"
        player = Thread(target=play, args=(recording, graph, Signal()), kwargs={"wait_s": 60.0})
        player.start()
        while True:
            try:
                message = await asyncio.wait_for(socket.recv(), 2.0)
            except TimeoutError:
                if not player.is_alive():
                    return received
                continue
            at_us = time.time_ns() // 1000
            document = json.loads(message)
            if document["type"] == "events":
                received += [
                    (parse_stamp(event["stamp"]), at_us)
                    for event in document["events"]
                    if event["type"] in DOOR_EVENTS
                ]
