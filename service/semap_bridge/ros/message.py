"""Messages as bytes and as values, of both kinds of ROS, by rosbags' definitions."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore
from semap_ingest.recording.definitions import MALFORMED, built_in_types

__all__ = ["MALFORMED", "Messages", "messages"]

NANOSECONDS = 1000


class Messages:
    """Reads and writes messages of one kind of ROS.

    store  of rosbags
    """

    def __init__(self, store: Typestore, is_ros1: bool) -> None:
        self.store = store
        self.is_ros1 = is_ros1

    def read(self, raw: bytes, type_name: str) -> Any:
        """raises one of MALFORMED"""
        return (self.store.deserialize_ros1 if self.is_ros1 else self.store.deserialize_cdr)(raw, type_name)

    def write(self, message: Any) -> bytes:
        """Its bytes, with the header of CDR in ROS 2."""
        name = message.__msgtype__
        return bytes((self.store.serialize_ros1 if self.is_ros1 else self.store.serialize_cdr)(message, name))

    def new(self, type_name: str, **fields: Any) -> Any:
        """A message; what is not said of it is zero or empty."""
        _, defined = self.store.fielddefs[type_name]
        values = {name: fields[name] if name in fields else self._nothing(kind) for name, kind in defined}
        unknown = fields.keys() - values.keys()
        if unknown:
            raise TypeError(f"{type_name} has no {', '.join(sorted(unknown))}")
        return self.store.types[type_name](**values)

    def header(self, stamp_us: int, frame: str) -> Any:
        seconds, rest_us = divmod(stamp_us, 1_000_000)
        stamp = self.new("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest_us * NANOSECONDS)
        return self.new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def point(self, x: float, y: float, z: float = 0.0) -> Any:
        return self.new("geometry_msgs/msg/Point", x=float(x), y=float(y), z=float(z))

    def pose(self, x: float, y: float, z: float = 0.0, yaw_rad: float = 0.0) -> Any:
        turned = self.new(
            "geometry_msgs/msg/Quaternion", z=float(np.sin(yaw_rad / 2)), w=float(np.cos(yaw_rad / 2))
        )
        return self.new("geometry_msgs/msg/Pose", position=self.point(x, y, z), orientation=turned)

    def _nothing(self, kind: Any) -> Any:
        node, of = kind
        if node == Nodetype.BASE:
            name, _ = of
            return (
                "" if name == "string" else False if name == "bool" else np.dtype(_dtype(name)).type(0).item()
            )
        if node == Nodetype.NAME:
            return self.new(of)
        (inner, inner_of), size = of
        count = size if node == Nodetype.ARRAY else 0
        if inner == Nodetype.BASE and inner_of[0] != "string":
            return np.zeros(count, dtype=_dtype(inner_of[0]))
        return [self._nothing((inner, inner_of)) for _ in range(count)]


def _dtype(name: str) -> str:
    return {"byte": "uint8", "char": "uint8", "octet": "uint8"}.get(name, name)


@cache
def messages(*, is_ros1: bool) -> Messages:
    """Of all types that semap speaks, those of semap_msgs among them."""
    store = built_in_types(is_ros1)
    folder = files("semap_bridge.ros") / "semap_msgs" / "msg"
    for each in sorted(folder.iterdir(), key=lambda path: path.name):
        name = f"semap_msgs/msg/{each.name.removesuffix('.msg')}"
        if name not in store.types:
            store.register(get_types_from_msg(each.read_text(), name))
    return Messages(store, is_ros1)
