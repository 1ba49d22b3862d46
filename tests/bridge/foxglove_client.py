"""A client of Foxglove's protocol that knows nothing of semap: what a topic means, its own schema says."""

from __future__ import annotations

import json
import struct
from base64 import b64decode
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from ssl import SSLContext
from typing import Any

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from patience import until
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from web_socket import connect
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

PROTOCOL = "foxglove.sdk.v1"
MESSAGE = 1
PUBLISH = 1


def decoder(name: str, schema: bytes):
    """Of protobuf messages, from a whole set of descriptors."""
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(name)).FromString


def cdr_decoder(name: str, definition: str):
    """Of messages of ROS 2, by the text of their type alone."""
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(definition, name))
    return lambda raw: store.deserialize_cdr(raw, name)


@dataclass
class AppClient:
    """Mutable: all that came. topics: what is offered, by name; came: topic, log time [ns] and message."""

    socket: ClientConnection
    topics: dict[str, dict[str, Any]] = field(default_factory=dict)
    came: list[tuple[str, int, Any]] = field(default_factory=list)
    server: dict[str, Any] = field(default_factory=dict)

    def subscribe(self, topics: Iterable[str]) -> None:
        wanted = [{"id": self.topics[each]["id"], "channelId": self.topics[each]["id"]} for each in topics]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def advertise(self, number: int, topic: str, **more: object) -> None:
        channel = {"id": number, "topic": topic, "encoding": "json", "schemaName": "", **more}
        self.socket.send(json.dumps({"op": "advertise", "channels": [channel]}))

    def publish(self, number: int, data: bytes) -> None:
        self.socket.send(struct.pack("<BI", PUBLISH, number) + data)

    def hear(self) -> None:
        """Take what has come, waiting a moment at most."""
        try:
            said = self.socket.recv(timeout=0.05)
        except (TimeoutError, ConnectionClosed):
            return
        if isinstance(said, bytes):
            self._take(said)
            return
        told = json.loads(said)
        if told["op"] == "serverInfo":
            self.server = told
        for each in told.get("channels", ()) if told["op"] == "advertise" else ():
            self.topics[each["topic"]] = each
        for number in told.get("channelIds", ()) if told["op"] == "unadvertise" else ():
            self.topics = {name: each for name, each in self.topics.items() if each["id"] != number}

    def of(self, topic: str) -> list[Any]:
        self.hear()
        return [message for name, _, message in self.came if name == topic]

    def _take(self, data: bytes) -> None:
        kind, number, log_time_ns = struct.unpack_from("<BIQ", data)
        assert kind == MESSAGE
        (channel,) = [each for each in self.topics.values() if each["id"] == number]
        body = data[13:]
        if channel["encoding"] == "json":
            message = json.loads(body)
        elif channel["encoding"] == "cdr":
            message = cdr_decoder(channel["schemaName"], channel["schema"])(body)
        else:
            assert channel["encoding"] == channel["schemaEncoding"] == "protobuf"
            message = decoder(channel["schemaName"], b64decode(channel["schema"]))(body)
        self.came.append((channel["topic"], log_time_ns, message))


@contextmanager
def app_client(port: int, ssl: SSLContext | None = None) -> Iterator[AppClient]:
    """A client, as soon as there is a server."""
    opened: list[ClientConnection] = []
    scheme = "ws" if ssl is None else "wss"

    def is_open() -> bool:
        with suppress(OSError):
            opened.append(
                connect(
                    f"{scheme}://localhost:{port}",
                    subprotocols=[PROTOCOL],
                    ssl=ssl,
                    max_size=None,
                    proxy=None,
                )
            )
        return bool(opened)

    until(is_open)
    with opened[0] as socket:
        yield AppClient(socket)
