"""Any JSON: which of its values say what, as a config tells.

A text of a config is a path where it begins with $, and else a text with named parts of the topic in braces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, PrivateAttr, model_validator

from semap.model.pose import Pose
from semap.store.map.placement import ROOT_FRAME
from semap_bridge.messages.path import PART, Path, TopicPattern, find, read_path
from semap_bridge.messages.told import (
    METRES,
    Located,
    Message,
    Told,
    Unit,
    Unusable,
    compass_rad,
    object_state,
    read_json,
    read_name,
    read_number,
    read_optional,
    read_stamp,
    read_text,
    shown,
)


def _is_path(text: str) -> str:
    read_path(text)
    return text


JsonPath = Annotated[str, AfterValidator(_is_path)]


class Origin(BaseModel):
    """Where the sender's x and y begin, and how they are turned."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0
    yaw_deg: float = 0.0

    def pose(self) -> Pose:
        """frame_T_sender"""
        half = math.radians(self.yaw_deg) / 2
        return Pose(self.x_m, self.y_m, self.z_m, qz=math.sin(half), qw=math.cos(half))


class Reading(BaseModel):
    """What messages of a format have in common.

    read  what a message says; raises Unusable
    """

    model_config = ConfigDict(extra="forbid", frozen=True, hide_input_in_errors=True, allow_inf_nan=False)

    topic: str = Field(description="Topics, with named parts such as uwb/{tag}.")
    names: dict[str, str] = Field(
        default_factory=dict, description="Names on the map, by those in messages; others stay."
    )
    std_m: float | None = Field(
        default=None, ge=0, description="Standard deviation of positions that come without one [m]."
    )
    frame: str = Field(default=ROOT_FRAME, description="Frame of the map that positions are in.")
    origin: Origin = Field(
        default=Origin(), description="Where the sender's origin is in `frame`: x_m, y_m, z_m, yaw_deg."
    )
    _pattern: TopicPattern = PrivateAttr()

    @model_validator(mode="after")
    def _require_topic(self) -> Reading:
        self._pattern = TopicPattern(self.topic)
        return self

    @property
    def wanted(self) -> str:
        """The topic filter to subscribe to."""
        return self._pattern.wanted

    @property
    def is_stamped(self) -> bool:
        """Whether its messages say when they are from."""
        return True

    @property
    def is_kept(self) -> bool:
        """Whether a broker may keep its messages for a bridge that is away."""
        return self.is_stamped

    def is_about(self, topic: str) -> bool:
        return self._pattern.match(topic) is not None

    def read(self, message: Message) -> Told:
        """What it says, of a topic that this is about; raises Unusable."""
        return self._read(message, self._pattern.match(message.topic) or {})

    def _read(self, message: Message, parts: Mapping[str, str]) -> Told:
        raise NotImplementedError

    def _named(self, name: str) -> str:
        return self.names.get(name, name)


class Template(Reading):
    """Positions of tracks, or states of objects, in any JSON."""

    format: Literal["template"] = "template"
    payload: Literal["json", "text"] = Field(
        default="json", description="text: the whole message is one text, which $ names."
    )
    each: JsonPath | None = Field(default=None, description="List in the message, of which each is read.")
    track: str | None = Field(default=None, description="Name of the track: a path, or {part} of the topic.")
    x: JsonPath | None = Field(default=None, description="In `unit`; longitude where `unit` is deg.")
    y: JsonPath | None = Field(default=None, description="In `unit`; latitude where `unit` is deg.")
    z: JsonPath | None = Field(default=None, description="In `unit`; in metres where `unit` is deg.")
    unit: Unit | Literal["deg"] = Field(
        default="m", description="Of x, y, z and std; deg: WGS 84, placed by the anchor of the map."
    )
    std: JsonPath | None = Field(default=None, description="Standard deviation, in `unit`, or m with deg.")
    heading: JsonPath | None = Field(default=None, description="Where it faces, in `heading_unit`.")
    heading_unit: Literal["rad", "deg", "compass"] = Field(
        default="deg", description="rad and deg: from x towards y; compass: degrees clockwise from y."
    )
    speed: JsonPath | None = Field(default=None, description="Speed [m/s].")
    instance: str | None = Field(
        default=None, description="Name of the object: a path, or {part} of the topic."
    )
    property_name: str = Field(
        default="door", alias="property", description="Property of the object: a text, or a path."
    )
    value: JsonPath | None = Field(default=None, description="Value of the property.")
    values: dict[str, str] = Field(
        default_factory=dict, description="Values on the map, by those in messages; others are refused."
    )
    stamp: JsonPath | None = Field(
        default=None,
        description="ISO 8601, or a number of s, ms, us or ns since 1970. [default: when it came]",
    )
    _paths: dict[str, Path] = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _require_one(self) -> Template:
        needed = ("x", "y") if self.track is not None else ("value",)
        if (self.track is None) == (self.instance is None):
            raise ValueError("give track, with x and y, or instance, with value")
        missing = [name for name in needed if getattr(self, name) is None]
        if missing:
            raise ValueError(f"give {' and '.join(missing)}, too")
        parts = TopicPattern(self.topic).parts
        for name in ("track", "instance", "property_name"):
            text = getattr(self, name) or ""
            unknown = set(PART.findall(text)) - set(parts)
            if unknown and not text.startswith("$"):
                raise ValueError(f"{name}: the topic has no part {', '.join(sorted(unknown))}")
        for name in Template.model_fields:
            text = getattr(self, name)
            if isinstance(text, str) and text.startswith("$"):
                self._paths[name] = read_path(text)
        return self

    @property
    def is_stamped(self) -> bool:
        return self.stamp is not None

    def _read(self, message: Message, parts: Mapping[str, str]) -> Told:
        if message.is_retained and not self.is_stamped and self.track is not None:
            return Told()  # nobody knows how old it is
        whole = self._whole(message)
        items = find(whole, self._paths["each"]) if self.each is not None else [whole]
        if not isinstance(items, list):
            raise Unusable("each is no list", shown(items))
        located, objects, unusable = [], [], []
        for item in items:
            try:
                stamp_us = message.came_us if self.stamp is None else read_stamp(self._at("stamp", item))
                if self.track is not None:
                    located.append(self._located(item, parts, stamp_us))
                else:
                    objects.append(
                        object_state(
                            self._name("instance", item, parts),
                            self._text("property_name", item, parts),
                            self._value(item),
                            stamp_us,
                        )
                    )
            except Unusable as error:
                unusable.append(error)
        return Told(located, objects, unusable=unusable)

    def _whole(self, message: Message) -> Any:
        if self.payload == "json":
            return read_json(message.payload)
        try:
            return message.payload.decode().strip()
        except UnicodeError as error:
            raise Unusable("not text", shown(message.payload)) from error

    def _at(self, name: str, item: object) -> object:
        return find(item, self._paths[name]) if name in self._paths else None

    def _text(self, name: str, item: object, parts: Mapping[str, str]) -> str:
        if name in self._paths:
            return read_name(self._at(name, item), name)
        return read_name(PART.sub(lambda part: parts[part[1]], getattr(self, name)), name)

    def _name(self, name: str, item: object, parts: Mapping[str, str]) -> str:
        return self._named(self._text(name, item, parts))

    def _value(self, item: object) -> str:
        value = read_text(self._at("value", item), "value")
        if self.values and value not in self.values:
            raise Unusable("unknown value", f"{shown(value)} is not among {', '.join(self.values)}")
        return self.values.get(value, value)

    def _located(self, item: object, parts: Mapping[str, str], stamp_us: int) -> Located:
        on_earth = self.unit == "deg"
        scale = 1.0 if self.unit == "deg" else METRES[self.unit]
        z, std = (read_optional(self._at(name, item), name) for name in ("z", "std"))
        heading = read_optional(self._at("heading", item), "heading")
        return Located(
            self._name("track", item, parts),
            stamp_us,
            read_number(self._at("x", item), "x") * scale,
            read_number(self._at("y", item), "y") * scale,
            None if z is None else z * scale,
            self.std_m if std is None else std * scale,
            None if heading is None else self._heading_rad(heading),
            read_optional(self._at("speed", item), "speed"),
            on_earth,
        )

    def _heading_rad(self, heading: float) -> float:
        if self.heading_unit == "compass":
            return compass_rad(heading)
        return math.remainder(heading if self.heading_unit == "rad" else math.radians(heading), math.tau)
