"""Which adapters there are: the one table. Each is a file, and of each the settings are read without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from semap.errors import InvalidInput
from semap_bridge.adapter import Adapter


@dataclass(frozen=True)
class Kind:
    """An adapter.

    adapter  module and class
    extra    what of semap has the packages that it needs; None: nothing more
    said     what it connects with
    """

    adapter: str
    extra: str | None
    said: str


FOLDER = "semap_bridge.adapters."
KINDS: Mapping[str, Kind] = {
    "ndjson": Kind("ndjson:Ndjson", None, "lines of JSON: from a file or TCP, to a file"),
    "mqtt": Kind("mqtt:Mqtt", "mqtt", "MQTT: any JSON, ESPresense, Frigate and omlox in, events out"),
    "home_assistant": Kind(
        "home_assistant:HomeAssistant", "mqtt", "Home Assistant: rooms, people, doors and rules, by MQTT"
    ),
    "omlox": Kind("omlox:OmloxHub", "omlox", "a hub of omlox: locations by WebSocket"),
    "ros2": Kind("ros.adapter:Ros2", "ros2", "robots of ROS 2: sensors and people, map and events"),
    "ros1": Kind("ros.adapter:Ros1", "ros1", "robots of ROS 1: the same"),
    "foxglove": Kind(
        "foxglove.bridge:Foxglove", "foxglove", "the Foxglove app: the map, who is on it, what happens"
    ),
    "bacnet": Kind(
        "bacnet:Bacnet", "bacnet", "BACnet/IP: presence and count of each room, with change of value"
    ),
    "kafka": Kind("kafka.bridge:Kafka", "kafka", "topics of Kafka: states in, events and changes out"),
    "nats": Kind("nats:Nats", "nats", "a stream of NATS JetStream: events and changes out"),
}


def adapter_of(kind: str, where: str) -> type[Adapter[Any]]:
    """raises InvalidInput where there is no such kind, or its packages are not installed"""
    known = KINDS.get(kind)
    if known is None:
        raise InvalidInput(f"there is no kind {kind!r}", f"Known are {', '.join(sorted(KINDS))}.", where)
    module, _, name = known.adapter.partition(":")
    try:
        found: type[Adapter[Any]] = getattr(import_module(f"{FOLDER}{module}"), name)
    except ImportError as error:
        if known.extra is None or (error.name or "").partition(".")[0] in ("semap", "semap_bridge"):
            raise
        raise InvalidInput(
            f"the kind {kind} needs the package {error.name}, which is not installed",
            f"pip install 'semap[{known.extra}]'",
            where,
        ) from error
    return found
