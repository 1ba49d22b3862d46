"""A node of ROS 1 for semap: topics in and out as bytes, over two pipes; run by a Python that has rospy.

rospy takes over logging, signals and threads of its process, and its packages are those of the system: so it
has a process of its own, which imports nothing of semap, by Python 3.7 or newer. A frame is the length of its
body and that of a head of JSON (4 bytes each, little-endian), the head, and bytes.

    in   {"do": "hear", "topics": [...]}  {"do": "publish", "topic", "kind", "md5", "definition", "latch"}
         {"do": "send", "topic"} + the message   {"do": "offers"}
    out  {"is": "ready"}  {"is": "heard", "topic", "type", "definition", "us"} + the message
         {"is": "offers", "offers": [...], "listeners": {...}}  {"is": "lost", "why"}

Start it with: python rospy_node.py IN_FD OUT_FD NAME
"""

from __future__ import annotations

import json
import os
import struct
import sys
import threading
import time
from typing import Any

HEAD = struct.Struct("<II")
QUEUE = {"sensor_msgs/Image": 3, "sensor_msgs/CompressedImage": 10}
FEW = 1000
WATCH_S = 1.0


class Pipe:
    def __init__(self, source: int, target: int) -> None:
        self.source = os.fdopen(source, "rb")
        self.target = os.fdopen(target, "wb")
        self.lock = threading.Lock()

    def read(self) -> tuple[dict[str, Any], bytes] | None:
        """A head and bytes; None at the end."""
        begin = self.source.read(HEAD.size)
        if len(begin) < HEAD.size:
            return None
        length, head_length = HEAD.unpack(begin)
        body = self.source.read(length)
        return json.loads(body[:head_length]), body[head_length:]

    def write(self, head: dict[str, Any], raw: bytes = b"") -> None:
        told = json.dumps(head).encode()
        with self.lock:
            self.target.write(HEAD.pack(len(told) + len(raw), len(told)) + told + raw)
            self.target.flush()


def type_of(topic_type: str, md5: str, definition: str) -> Any:
    """A class of messages that are bytes already, as rospy wants one."""
    import genpy  # noqa: PLC0415  (what is wrong with it is told)

    class Raw(genpy.Message):  # type: ignore[misc]
        _type, _md5sum, _full_text, _has_header = topic_type, md5, definition, False
        __slots__ = ("raw",)
        _slot_types = ("uint8[]",)

        def __init__(self, raw: bytes = b"") -> None:
            self.raw = raw

        def serialize(self, buff: Any) -> None:
            buff.write(self.raw)

    return Raw


class Node:
    def __init__(self, pipe: Pipe, name: str) -> None:
        import rosgraph  # noqa: PLC0415
        import rospy  # noqa: PLC0415

        self.pipe, self.rospy = pipe, rospy
        rospy.init_node(name, disable_signals=True)
        self.master = rosgraph.Master(rospy.get_name())
        self.run_id = self.master.getParam("/run_id")
        self.subscribers: dict[str, Any] = {}
        self.publishers: dict[str, Any] = {}

    def heard(self, message: Any, topic: str) -> None:
        told = message._connection_header
        self.pipe.write(
            {
                "is": "heard",
                "topic": topic,
                "type": told["type"],
                "definition": told.get("message_definition", ""),
                "us": time.time_ns() // 1000,
            },
            message._buff,
        )

    def hear(self, topics: dict[str, str]) -> None:
        for topic in set(self.subscribers) - set(topics):
            self.subscribers.pop(topic).unregister()
        for topic, kind in topics.items():
            if topic not in self.subscribers:
                self.subscribers[topic] = self.rospy.Subscriber(
                    topic,
                    self.rospy.AnyMsg,
                    self.heard,
                    callback_args=topic,
                    queue_size=QUEUE.get(kind, FEW),
                    buff_size=1 << 24,
                    tcp_nodelay=True,
                )

    def publish(self, topic: str, kind: str, md5: str, definition: str, latch: bool) -> None:
        self.publishers[topic] = self.rospy.Publisher(
            topic, type_of(kind, md5, definition), latch=latch, queue_size=FEW, tcp_nodelay=True
        )

    def offers(self) -> None:
        published, _, _ = self.master.getSystemState()
        types = dict(self.master.getTopicTypes())
        own = self.rospy.get_name()
        found: list[dict[str, Any]] = []
        for topic, nodes in published:
            others = sorted(node for node in nodes if node != own)
            if others and topic in types:
                found.append({"topic": topic, "type": types[topic], "nodes": others})
        listeners = {topic: each.get_num_connections() for topic, each in self.publishers.items()}
        self.pipe.write({"is": "offers", "offers": found, "listeners": listeners})

    def watch(self) -> None:
        """A master that went away, or was started anew, knows nothing of this node any more."""
        import rosgraph  # noqa: PLC0415

        master = rosgraph.Master(self.rospy.get_name())  # a connection is of one thread
        while True:
            time.sleep(WATCH_S)
            try:
                if master.getParam("/run_id") != self.run_id:
                    raise OSError("it was started anew")
            except Exception as error:
                self.pipe.write({"is": "lost", "why": str(error)})
                os._exit(0)

    def run(self) -> None:
        threading.Thread(target=self.watch, daemon=True).start()
        self.pipe.write({"is": "ready"})
        while True:
            asked = self.pipe.read()
            if asked is None:
                self.rospy.signal_shutdown("done")
                return
            head, raw = asked
            do = head.pop("do")
            if do == "send":
                publisher = self.publishers[head["topic"]]
                publisher.publish(publisher.data_class(raw))
            else:
                getattr(self, do)(**head)


def main() -> None:
    source, target, name = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    pipe = Pipe(source, target)
    try:
        node = Node(pipe, name)
    except Exception as error:
        pipe.write({"is": "lost", "why": f"{type(error).__name__}: {error}"})
        return
    node.run()
    os._exit(0)  # rospy's threads would wait


if __name__ == "__main__":
    main()
