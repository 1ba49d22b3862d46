"""The graph of ROS 1 by rospy, which runs in a process of its own (`rospy_node`)."""

from __future__ import annotations

import json
import os
import socket
import struct
import subprocess
import threading
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from importlib.resources import as_file, files
from typing import IO, Any
from urllib.parse import urlsplit

from semap.errors import ServiceUnreachable
from semap_bridge.ros.graph import Graph, Heard, Offer, Publisher
from semap_bridge.ros.message import messages

NODE = files("semap_bridge.ros") / "rospy_node.py"
HEAD = struct.Struct("<II")
"""Of a frame: the length of its body, and of the JSON that the body begins with."""
START_S = 20.0
ANSWER_S = 5.0
CONNECT_S = 2.0
MOST = 5000
"""Messages that wait to be taken; of more the oldest are dropped."""
NO_ROSPY = "Debian: apt-get install python3-rospy; else name a Python that has it: python: PATH"


class Rospy(Graph):
    """Mutable: the process, and what it told."""

    is_ros1 = True

    def __init__(self, master: str, node: str, own_address: str | None, python: str) -> None:
        """raises ServiceUnreachable"""
        _require_master(master)
        self._messages = messages(is_ros1=True)
        self._process, self._out, self._in = _started(master, node, own_address, python)
        self._changed = threading.Condition()
        self._writing = threading.Lock()
        self._came: deque[Heard] = deque(maxlen=MOST)
        self._told: dict[str, Any] | None = None
        self._listeners: Mapping[str, int] = {}
        self._is_ready, self._lost = False, ""
        self._thread = threading.Thread(target=self._listen, name="rospy", daemon=True)
        self._thread.start()
        with self._changed:
            self._changed.wait_for(lambda: self._is_ready or self._lost, START_S)
        if not self._is_ready:
            why = self._lost or "it did not answer"
            self.close()
            raise ServiceUnreachable(f"rospy could not be started by {python}: {why}", NO_ROSPY)

    def offers(self) -> Sequence[Offer]:
        with self._changed:
            self._told = None
        self._ask({"do": "offers"})
        with self._changed:
            self._changed.wait_for(lambda: self._told is not None or self._lost, ANSWER_S)
            self._require_there()
            told: dict[str, Any] = self._told or {"offers": []}
        return [
            Offer(
                each["topic"],
                each["type"].replace("/", "/msg/", 1),
                len(each["nodes"]),
                tuple(each["nodes"]),
            )
            for each in told["offers"]
        ]

    def hear(self, offers: Collection[Offer]) -> None:
        self._ask({"do": "hear", "topics": {each.topic: _ros1_name(each.type) for each in offers}})

    def take(self, wait_s: float) -> Sequence[Heard]:
        with self._changed:
            self._changed.wait_for(lambda: self._came or self._lost, wait_s)
            self._require_there()
            taken = list(self._came)
            self._came.clear()
        return taken

    def knows(self, type_name: str) -> bool:
        return type_name in self._messages.store.fielddefs

    def publish(self, topic: str, type_name: str, *, is_latched: bool = False) -> Publisher:
        definition, md5 = self._messages.store.generate_msgdef(type_name, ros_version=1)
        self._ask(
            {
                "do": "publish",
                "topic": topic,
                "kind": _ros1_name(type_name),
                "md5": md5,
                "definition": definition,
                "latch": is_latched,
            }
        )
        return _Topic(self, topic)

    def send(self, topic: str, raw: bytes) -> None:
        self._ask({"do": "send", "topic": topic}, raw)

    def listeners(self, topic: str) -> int:
        self.offers()
        return self._listeners.get(topic, 0)

    def close(self) -> None:
        with suppress(OSError):
            self._in.close()  # which ends it
        try:
            self._process.wait(CONNECT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join()
        self._out.close()

    def _ask(self, head: Mapping[str, Any], raw: bytes = b"") -> None:
        with self._changed:
            self._require_there()
        try:
            with self._writing:
                write_frame(self._in, head, raw)
        except OSError as error:
            raise ServiceUnreachable(f"The process of rospy went away: {error}", "") from error

    def _require_there(self) -> None:
        if self._lost:
            raise ServiceUnreachable(f"ROS's master is lost: {self._lost}", "Start it: roscore")

    def _listen(self) -> None:
        while (frame := read_frame(self._out)) is not None:
            head, raw = frame
            with self._changed:
                match head["is"]:
                    case "ready":
                        self._is_ready = True
                    case "lost":
                        self._lost = head["why"]
                    case "offers":
                        self._told, self._listeners = head, head["listeners"]
                    case "heard":
                        kind = head["type"].replace("/", "/msg/", 1)
                        self.lost += len(self._came) == MOST
                        self._came.append(Heard(head["topic"], kind, head["definition"], raw, head["us"]))
                self._changed.notify_all()
        with self._changed:
            self._lost = self._lost or "the process of rospy ended"
            self._changed.notify_all()


class _Topic(Publisher):
    def __init__(self, graph: Rospy, topic: str) -> None:
        self._graph, self._topic = graph, topic

    def send(self, raw: bytes, sent_us: int | None = None) -> None:
        self._graph.send(self._topic, raw)

    def listeners(self) -> int:
        return self._graph.listeners(self._topic)


def _require_master(master: str) -> None:
    """Raises ServiceUnreachable where nobody listens: rospy would wait without a word."""
    address = urlsplit(master)
    try:
        socket.create_connection((address.hostname or "", address.port or 11311), CONNECT_S).close()
    except (OSError, ValueError) as error:
        raise ServiceUnreachable(
            f"No master of ROS answers at {master}: {error}.", "Start it: roscore, or correct `master`."
        ) from error


def _started(
    master: str, node: str, own_address: str | None, python: str
) -> tuple[subprocess.Popen[bytes], IO[bytes], IO[bytes]]:
    """The process, what it tells, and what it is told."""
    from_node, tell = os.pipe()
    hear, to_node = os.pipe()
    environment = {**os.environ, "ROS_MASTER_URI": master, "ROSCONSOLE_STDOUT_LINE_BUFFERED": "1"}
    environment.pop("VIRTUAL_ENV", None)
    if own_address is not None:
        environment["ROS_IP"] = own_address
    try:
        with as_file(NODE) as path:
            process = subprocess.Popen(
                [python, str(path), str(hear), str(tell), node],
                env=environment,
                pass_fds=(hear, tell),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
    except OSError as error:
        os.close(from_node)
        os.close(to_node)
        raise ServiceUnreachable(f"{python} cannot be run: {error.strerror}.", NO_ROSPY) from error
    finally:
        os.close(hear)
        os.close(tell)
    return process, os.fdopen(from_node, "rb"), os.fdopen(to_node, "wb")


def read_frame(stream: IO[bytes]) -> tuple[dict[str, Any], bytes] | None:
    """The next head and bytes; None at the end."""
    begin = stream.read(HEAD.size)
    if len(begin) < HEAD.size:
        return None
    length, head_length = HEAD.unpack(begin)
    body = stream.read(length)
    return json.loads(body[:head_length]), body[head_length:]


def write_frame(stream: IO[bytes], head: Mapping[str, Any], raw: bytes) -> None:
    told = json.dumps(head).encode()
    stream.write(HEAD.pack(len(told) + len(raw), len(told)) + told + raw)
    stream.flush()


def _ros1_name(type_name: str) -> str:
    return type_name.replace("/msg/", "/", 1)
