"""A robot's own topics in the app, in its own bytes: those that somebody looks at are heard.

The frames of a robot have topics of the same names as those of the map, so they are given below `/robot`.
"""

from __future__ import annotations

import time
from collections.abc import Collection, Mapping
from threading import Event as Signal
from threading import Lock, Thread

from foxglove import Channel, Context, Schema
from pydantic import Field

from semap.errors import ServiceUnreachable
from semap_bridge import context as bridge
from semap_bridge.adapters.foxglove.channels import OWN_TOPICS
from semap_bridge.ros.graph import Graph, Offer
from semap_bridge.ros.message import messages
from semap_bridge.ros.network import Ros1Network, Ros2Network, TopicName

SHOWN = {
    f"{package}/msg/{name}"
    for package, names in {
        "sensor_msgs": ("LaserScan", "Image", "CompressedImage", "CameraInfo", "PointCloud2"),
        "vision_msgs": ("Detection2DArray", "Detection3DArray"),
        "tf2_msgs": ("TFMessage",),
    }.items()
    for name in names
}
"""Types that are shown where no topics are named."""
LOOK_S = 0.5
WAIT_S = 0.1


class _Topics:
    topics: tuple[TopicName, ...] = Field(
        default=(), description="Which. [default: scans, images, clouds, detections, tf]"
    )


class Ros2Topics(_Topics, Ros2Network):
    """Topics of a robot of ROS 2, and how it is reached."""


class Ros1Topics(_Topics, Ros1Network):
    """Topics of a robot of ROS 1, and how it is reached."""


class RobotTopics:
    """Mutable: a thread that passes on, from `start` to `stop`.

    raised  what it ended with, where that was not `stop`
    """

    def __init__(self, scene: Context, told: bridge.Context, graph: Graph, topics: Collection[str]) -> None:
        self._scene, self._told, self._graph, self._topics = scene, told, graph, topics
        self._channels: dict[str, Channel] = {}
        self._refused: set[str] = set()
        self._lock = Lock()
        self._anew: set[str] = set()
        self._stop = Signal()
        self._thread = Thread(target=self._run, name="foxglove robot")
        self.raised: ServiceUnreachable | None = None

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Leave the graph."""
        self._stop.set()
        self._thread.join()
        self._graph.close()

    def wanted(self, topics: Collection[str]) -> None:
        """Somebody subscribed to topics: what was said once and for all is said again."""
        with self._lock:
            self._anew |= {each for each in topics if each in self._channels}

    def _run(self) -> None:
        look_at_s = 0.0
        try:
            while not self._stop.is_set():
                if time.monotonic() >= look_at_s:
                    look_at_s = time.monotonic() + LOOK_S
                    self._look()
                for heard in self._graph.take(WAIT_S):
                    channel = self._channels.get(_shown_as(heard.topic))
                    if channel is not None:
                        channel.log(heard.raw, log_time=heard.sent_us * 1000)
        except ServiceUnreachable as error:
            self.raised = error

    def _look(self) -> None:
        offers = {_shown_as(each.topic): each for each in self._graph.offers() if self._is_shown(each)}
        with self._lock:
            anew, self._anew = self._anew, set()
            for topic, offer in offers.items():
                if topic not in self._channels:
                    self._offer(topic, offer)
        if again := {topic for topic, each in offers.items() if each.is_latched} & anew:
            self._hear(offers, again)
        self._hear(offers, ())

    def _hear(self, offers: Mapping[str, Offer], but: Collection[str]) -> None:
        self._graph.hear(
            [
                offer
                for topic, offer in offers.items()
                if topic not in but and topic in self._channels and self._channels[topic].has_sinks()
            ]
        )

    def _is_shown(self, offer: Offer) -> bool:
        return offer.topic in self._topics if self._topics else offer.type in SHOWN

    def _offer(self, topic: str, offer: Offer) -> None:
        is_ros1 = self._graph.is_ros1
        try:
            store = messages(is_ros1=is_ros1).store
            text, _ = store.generate_msgdef(offer.type, ros_version=1 if is_ros1 else 2)
        except KeyError:
            if topic not in self._refused:
                self._refused.add(topic)
                self._told.refuse("a topic of a type that is not known", f"{topic}: {offer.type}")
            return
        name = offer.type.replace("/msg/", "/") if is_ros1 else offer.type
        schema = Schema(name=name, encoding="ros1msg" if is_ros1 else "ros2msg", data=text.encode())
        self._channels[topic] = Channel(
            topic, schema=schema, message_encoding="ros1" if is_ros1 else "cdr", context=self._scene
        )


def _shown_as(topic: str) -> str:
    return f"/robot{topic}" if topic in OWN_TOPICS else topic
