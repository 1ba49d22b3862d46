"""Time from a position by MQTT to its event at a client, with a real broker and all of semap in between.

People walk between two rooms, one state each at a time, as tags send them: by themselves. The clock starts
before a position is published with QoS 1, and stops when a client has its event: of the WebSocket, and of
MQTT, where a bridge writes events. `stored_ms` is until the relation has changed, `made_ms` until
the worker has written the event, both before the commit; `broker_ms` is what a message takes through
the broker alone.
"""

from __future__ import annotations

import asyncio
import json
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event as Signal
from threading import Thread

import numpy as np
import paho.mqtt.client as paho
import websockets
from semap_service.processes.port import free_port
from semap_service.processes.supervisor import Supervisor

from bench.crowd import Floor, build_map
from bench.figure import Rows, percentiles
from bench.latency import await_service
from semap.store.database.connection import connect
from semap.timeline.stamp import parse_stamp, rfc3339, to_datetime

MAP = "mqtt"
TRACKS = 20
ROUNDS, ROUND_S = 5, 6.0
PATIENCE_S = 60.0
FLOOR = Floor(2, 1)
HERE, THERE = (1.0, 1.0), (6.0, 1.0)
CONFIG = """
map: {map}
bridges:
  - name: tags
    kind: mqtt
    broker: {{port: {port}}}
    read:
      - {{topic: "tags/{{tag}}", track: "{{tag}}", x: $.x, y: $.y, stamp: $.stamp}}
  - name: events
    kind: mqtt
    broker: {{port: {port}}}
    write: events
"""
MADE = """
    select (extract(epoch from stamp) * 1e6)::bigint, extract(epoch from created_at)::float8
    from semap.event where type = 'entered'
"""
STORED = """
    select (extract(epoch from stamp) * 1e6)::bigint, extract(epoch from received_at)::float8
    from semap.relation_change where kind = 'began'
"""


@dataclass
class Heard:
    """When each event or message was there [s since 1970], by the stamp of its state [us]."""

    sent_s: dict[int, float] = field(default_factory=dict)
    through_broker_s: dict[int, float] = field(default_factory=dict)
    by_mqtt_s: dict[int, float] = field(default_factory=dict)
    by_socket_s: dict[int, float] = field(default_factory=dict)


def is_possible() -> bool:
    """Whether there is a broker to measure with."""
    return _program() is not None


def measure(
    dsn: str, rates: tuple[int, ...] = (20, 200), round_s: float = ROUND_S, rounds: int = ROUNDS
) -> Rows:
    """A row for each rate of positions; a round before the others warms up."""
    with connect(dsn) as connection:
        build_map(connection, MAP, FLOOR.rooms(), 1, 1)
    port, service = free_port(), free_port()
    with _broker(port), Supervisor(dsn) as supervisor, tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "bridges.yaml")
        config.write_text(CONFIG.format(map=MAP, port=port))
        supervisor.start("work")
        supervisor.start("serve", "--port", str(service), "--without-tokens")
        for name in ("tags", "events"):
            supervisor.start("bridge", "run", str(config), "--only", name)
        await_service(service)
        return [_measure(dsn, port, service, rate, round_s, rounds) for rate in rates]


def _measure(dsn: str, port: int, service: int, rate: int, round_s: float, rounds: int) -> dict[str, object]:
    heard = Heard()
    with _clients(port, heard) as client:
        begun_us = asyncio.run(_listen(service, heard, client, rate, (rounds + 1) * round_s))
    with connect(dsn) as connection:
        made, stored = (dict(connection.execute(each).fetchall()) for each in (MADE, STORED))
    asked = [stamp for stamp in heard.sent_s if stamp >= begun_us]

    def delays(there_s: dict[int, float]) -> list[list[float]]:
        found: list[list[float]] = [[] for _ in range(rounds + 1)]
        for stamp_us in asked:
            if stamp_us in there_s:
                number = min(int((stamp_us - begun_us) / 1e6 / round_s), rounds)
                found[number].append(1e3 * (there_s[stamp_us] - heard.sent_s[stamp_us]))
        return found[1:]

    by_mqtt = percentiles(delays(heard.by_mqtt_s))
    return {
        "positions_per_s": rate,
        "events": len(heard.by_socket_s),
        **percentiles(delays(heard.by_socket_s)),
        "mqtt_p50_ms": by_mqtt["p50_ms"],
        "mqtt_p99_ms": by_mqtt["p99_ms"],
        "broker_ms": percentiles(delays(heard.through_broker_s))["p50_ms"],
        "stored_ms": percentiles(delays(stored))["p50_ms"],
        "made_ms": percentiles(delays(made))["p50_ms"],
    }


async def _listen(service: int, heard: Heard, client: paho.Client, rate: int, length_s: float) -> int:
    """Hear of events by the WebSocket while positions are sent; since when they count [us]."""
    begun: list[int] = []
    async with websockets.connect(f"ws://127.0.0.1:{service}/events/feed?map={MAP}") as socket:
        await socket.recv()
        writer = Thread(target=_send, args=(client, heard, rate, length_s, begun))
        writer.start()
        while True:
            try:
                message = await asyncio.wait_for(socket.recv(), 2.0)
            except TimeoutError:
                if not writer.is_alive():
                    return begun[0]
                continue
            at_s = time.time()
            document = json.loads(message)
            if document["type"] == "events":
                for event in document["events"]:
                    if event["type"] == "entered":
                        heard.by_socket_s[parse_stamp(event["stamp"])] = at_s


def _send(client: paho.Client, heard: Heard, rate: int, length_s: float, begun: list[int]) -> None:
    """Each tag in its turn goes to the other room, once events are heard of."""
    deadline_s = time.time() + PATIENCE_S
    while not (heard.by_socket_s and heard.by_mqtt_s):
        for place in (HERE, THERE):
            _say(client, heard, f"first {rate}", place)
            Signal().wait(0.2)
        if time.time() > deadline_s:
            raise TimeoutError("No event came.")
    dice = np.random.default_rng(1)
    started_s = time.time()
    begun.append(int(started_s * 1e6))
    due_s, number = started_s, 0
    while due_s < started_s + length_s:
        Signal().wait(max(due_s - time.time(), 0))
        _say(client, heard, f"{rate} {number % TRACKS}", (HERE, THERE)[number // TRACKS % 2])
        due_s += dice.uniform(0.5, 1.5) / rate
        number += 1


def _say(client: paho.Client, heard: Heard, tag: str, place: tuple[float, float]) -> None:
    at_s = time.time()
    stamp_us = int(at_s * 1e6)
    heard.sent_s[stamp_us] = at_s
    said = {"x": place[0], "y": place[1], "stamp": rfc3339(to_datetime(stamp_us))}
    client.publish(f"tags/{tag}", json.dumps(said), qos=1)


@contextmanager
def _clients(port: int, heard: Heard) -> Iterator[paho.Client]:
    """One that publishes positions, and beside it one that hears them, and events."""

    def take(_client: object, _data: object, message: paho.MQTTMessage) -> None:
        at_s = time.time()
        said = json.loads(message.payload)
        if message.topic == "events":
            if said["data"]["type"] == "entered":
                heard.by_mqtt_s.setdefault(parse_stamp(said["data"]["stamp"]), at_s)
        else:
            heard.through_broker_s[parse_stamp(said["stamp"])] = at_s

    with _client(port) as publisher, _client(port) as listener:
        listener.on_message = take
        listener.subscribe([("tags/#", 1), ("events", 1)])
        yield publisher


@contextmanager
def _client(port: int) -> Iterator[paho.Client]:
    def at_once(_client: object, _data: object, connection: socket.socket) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    client = paho.Client(paho.CallbackAPIVersion.VERSION2, protocol=paho.MQTTv5)
    client.on_socket_open = at_once
    is_there = Signal()
    client.on_connect = lambda *_: is_there.set()
    client.connect("127.0.0.1", port)
    client.loop_start()
    try:
        if not is_there.wait(PATIENCE_S):
            raise TimeoutError("The broker does not answer.")
        yield client
    finally:
        client.disconnect()
        client.loop_stop()


@contextmanager
def _broker(port: int) -> Iterator[None]:
    process = subprocess.Popen([str(_program()), "-p", str(port)], stderr=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(5)


def _program() -> str | None:
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")
