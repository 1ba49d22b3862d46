"""A real MQTT broker for a test: mosquitto on a free port, which can go away and come back."""

from __future__ import annotations

import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from queue import Queue

import paho.mqtt.client as paho
import pytest
from patience import until
from semap_service.processes.port import free_port

PROGRAM = shutil.which(
    "mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin:/opt/homebrew/sbin"
)
needs_mosquitto = pytest.mark.skipif(
    PROGRAM is None, reason="there is no mosquitto: apt-get install mosquitto"
)


@dataclass
class Mosquitto:
    """A broker that runs from `start` to `stop`; `more` are lines of its config.

    disk_is_full  nothing can be written to a file, which it meets as it meets a full disk
    """

    folder: Path
    more: str = "allow_anonymous true\n"
    port: int = field(default_factory=free_port)
    disk_is_full: bool = False
    process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        config = self.folder / "mosquitto.conf"
        kept = f"persistence true\npersistence_location {self.folder}/\n"
        config.write_text(f"user root\nlistener {self.port} 127.0.0.1\n{kept}{self.more}")
        full = "trap '' XFSZ; ulimit -f 0; " if self.disk_is_full else ""
        self.process = subprocess.Popen(
            ["sh", "-c", f'{full}exec {PROGRAM} -c "{config}"'],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        until(self._listens, self._require_alive)

    def stop(self) -> None:
        if self.process is not None:
            self.process.terminate()
            self.process.wait()
            self.process = None

    def _require_alive(self) -> str:
        assert self.process is not None
        assert self.process.poll() is None, "mosquitto ended"
        return "mosquitto does not listen"

    def _listens(self) -> bool:
        try:
            socket.create_connection(("127.0.0.1", self.port)).close()
        except OSError:
            return False
        return True


@dataclass
class Peer:
    """A client beside semap: what it heard, in order, and what is retained."""

    client: paho.Client
    heard: Queue[paho.MQTTMessage] = field(default_factory=Queue)
    retained: dict[str, bytes] = field(default_factory=dict)

    def say(self, topic: str, payload: str | bytes, *, retain: bool = False) -> None:
        """Published, and the broker has it."""
        self.client.publish(topic, payload, qos=1, retain=retain).wait_for_publish(60)

    def take(self, _client: object, _data: object, message: paho.MQTTMessage) -> None:
        self.heard.put(message)
        if message.payload:
            self.retained[message.topic] = message.payload
        else:
            self.retained.pop(message.topic, None)


@contextmanager
def broker(folder: Path, more: str = "allow_anonymous true\n") -> Iterator[Mosquitto]:
    made = Mosquitto(folder, more)
    made.start()
    try:
        yield made
    finally:
        made.stop()


@contextmanager
def peer(port: int, *topics: str, user: str | None = None, password: str | None = None) -> Iterator[Peer]:
    """A client of its own, subscribed to topics."""
    client = paho.Client(paho.CallbackAPIVersion.VERSION2, protocol=paho.MQTTv5)
    if user is not None:
        client.username_pw_set(user, password)
    made = Peer(client)
    subscribed: list[int] = []
    client.on_message = made.take
    client.on_subscribe = lambda *given: subscribed.append(given[2])
    client.on_connect = lambda *given: [client.subscribe(each, 1) for each in topics]
    client.connect("127.0.0.1", port)
    client.loop_start()
    try:
        until(lambda: len(subscribed) >= len(topics) and client.is_connected())
        yield made
    finally:
        client.disconnect()
        client.loop_stop()
