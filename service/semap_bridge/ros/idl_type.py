"""Types of ROS 2 as DDS knows them, made of rosbags' definitions; their bytes pass as they are.

Cyclone's Python would decode them in Python, which takes ten times as long as rosbags does.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from cyclonedds.idl import IdlStruct, make_idl_struct
from cyclonedds.idl import types as _types
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

types: Any = _types

BASES: dict[str, Any] = {
    "bool": bool,
    "byte": types.uint8,
    "char": types.uint8,
    "string": str,
    "wstring": str,
    "octet": types.uint8,
    **{
        f"{sign}int{size}": getattr(types, f"{sign}int{size}")
        for sign in ("", "u")
        for size in (8, 16, 32, 64)
    },
    "float32": types.float32,
    "float64": types.float64,
}


class Raw:
    """A message as CDR bytes, with its header; `sample_info` is set by Cyclone."""

    def __init__(self, raw: bytes = b"") -> None:
        self.raw = raw
        self.sample_info: Any = None

    def serialize(self, *_: object, **__: object) -> bytes:
        return self.raw

    @classmethod
    def deserialize(cls, data: bytes, *_: object, **__: object) -> Raw:
        return cls(data)


@lru_cache(maxsize=200)
def idl_type(store: Typestore, name: str) -> type[Any]:
    """The class of a type whose instances are made of bytes: `idl_type(store, name)(raw)`."""
    made = _struct(store, name)
    made.__init__ = Raw.__init__
    made.serialize = Raw.serialize
    made.deserialize = made.deserialize_key = classmethod(Raw.deserialize.__func__)  # type: ignore[attr-defined]
    return made


def idl_name(name: str) -> str:
    """sensor_msgs/msg/LaserScan as sensor_msgs::msg::dds_::LaserScan_"""
    package, _, kind = name.rpartition("/msg/")
    return f"{package}::msg::dds_::{kind}_"


def ros_name(idl: str) -> str:
    """The way back; what is no type of ROS stays as it is."""
    package, middle, kind = idl.partition("::msg::dds_::")
    return f"{package}/msg/{kind[:-1]}" if middle and kind.endswith("_") else idl


@lru_cache(maxsize=1000)
def _nested(store: Typestore, name: str) -> type[IdlStruct]:
    return _struct(store, name)


def _struct(store: Typestore, name: str) -> type[Any]:
    _, fields = store.fielddefs[name]
    return make_idl_struct(
        name.replace("/", "_"),
        idl_name(name).replace("::", "."),
        {field: _field(store, kind) for field, kind in fields},
        dataclassify=False,
    )


def _field(store: Typestore, kind: Any) -> Any:
    node, of = kind
    if node == Nodetype.BASE:
        base, limit = of
        return types.bounded_str[limit] if limit else BASES[base]
    if node == Nodetype.NAME:
        return _nested(store, of)
    inner, size = of
    if node == Nodetype.ARRAY:
        return types.array[_field(store, inner), size]
    return types.sequence[_field(store, inner), size] if size else types.sequence[_field(store, inner)]
