"""What one message says, and how its values are read; what cannot be used raises `Unusable`, nothing else."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from semap_ingest.named_states import EARLIEST_US, LATEST_US

from semap.errors import InvalidInput
from semap.model.object_state import NewObjectState
from semap.timeline.stamp import parse_stamp, to_datetime

LONGEST_TEXT, LONGEST_NAME = 1000, 200
LARGEST_S, LARGEST_MS, LARGEST_US = 1e11, 1e14, 1e17
"""A number below the first is a stamp in seconds, below the second in milliseconds, and so on."""
OLDEST_US = 946_684_800_000_000
SHOWN = 60


class Unusable(Exception):
    """A message that cannot be used: why in few words, by which it is counted, and in detail."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason, self.detail = reason, detail

    def of(self, whose: str) -> Unusable:
        """The same, which says where it came from."""
        return Unusable(self.reason, f"{whose}: {self.detail}")


@dataclass(frozen=True)
class Located:
    """Where something was seen.

    x, y     [m] in a frame of the sender, or longitude and latitude [degrees] where `on_earth`
    heading  [rad] from x towards y, in that frame; on earth: from east towards north
    """

    track: str
    stamp_us: int
    x: float
    y: float
    z_m: float | None = None
    std_m: float | None = None
    heading_rad: float | None = None
    speed_mps: float | None = None
    on_earth: bool = False


@dataclass(frozen=True)
class CameraReport:
    """What a program that watches a camera says of something in its picture, as it came."""

    camera: str
    object: str
    stamp_us: int
    document: Mapping[str, Any]


@dataclass(frozen=True)
class CameraBox:
    """Where a camera's program sees an object in its picture; corners x_min, y_min, x_max, y_max [px]."""

    camera: str
    object: str
    stamp_us: int
    corners_px: tuple[float, float, float, float]
    score: float
    label: str


@dataclass(frozen=True)
class Told:
    """What a message says; ended: tracks that are gone, each with when [us since 1970].

    unseen  objects that cameras do not follow any more: camera and id
    """

    located: Sequence[Located] = ()
    objects: Sequence[NewObjectState] = ()
    ended: Sequence[tuple[str, int]] = ()
    reports: Sequence[CameraReport] = ()
    boxes: Sequence[CameraBox] = ()
    unseen: Sequence[tuple[str, str]] = ()
    unusable: Sequence[Unusable] = field(default=())


@dataclass(frozen=True)
class Message:
    """A message as it came; is_retained: the broker kept it from before."""

    topic: str
    payload: bytes
    came_us: int
    is_retained: bool = False


NOTHING = Told()


def read_json(payload: bytes) -> Any:
    """raises  Unusable"""
    try:
        return json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise Unusable("not JSON", f"{shown(payload)}: {error}") from error


def read_object(value: object, what: str = "message") -> Mapping[str, Any]:
    """raises  Unusable"""
    if not isinstance(value, Mapping):
        raise Unusable(f"{what} is no object", shown(value))
    return value


def read_number(value: object, what: str) -> float:
    """A number, or a text that is one; raises Unusable."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise Unusable(f"{what} is no number", shown(value))
    try:
        number = float(value)
    except (ValueError, OverflowError) as error:
        raise Unusable(f"{what} is no number", shown(value)) from error
    if not math.isfinite(number):
        raise Unusable(f"{what} is no number", shown(value))
    return number


def read_optional(value: object, what: str) -> float | None:
    """None where there is none."""
    return None if value is None else read_number(value, what)


def read_text(value: object, what: str) -> str:
    """A text, also of a number or of true and false; raises Unusable."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        value = repr(value) if abs(value) < 1e18 else ""
    if not isinstance(value, str) or not value.strip() or "\0" in value or len(value) > LONGEST_TEXT:
        raise Unusable(f"{what} is no text", shown(value))
    try:
        value.encode()
    except UnicodeError as error:
        raise Unusable(f"{what} is no text", shown(value)) from error
    return value


def read_name(value: object, what: str, longest: int = LONGEST_NAME) -> str:
    """A text that names something, of a track or a property; raises Unusable."""
    name = read_text(value, what)
    if len(name) > longest:
        raise Unusable(f"{what} is too long", f"{shown(name)}: {longest} characters at most")
    return name


def read_topic(value: object) -> str:
    """A topic to publish to; raises Unusable."""
    topic = read_text(value, "topic")
    if "+" in topic or "#" in topic:
        raise Unusable("topic has a wildcard", shown(topic))
    return topic


def read_stamp(value: object) -> int:
    """Microseconds since 1970 of an ISO 8601 text, or of a number of s, ms, us or ns; raises Unusable.

    A stamp before 2000 is refused: that of a device that has not set its clock, or counts from its start.
    """
    stamp_us = _stamp_us(value)
    if not EARLIEST_US <= stamp_us < LATEST_US:
        raise Unusable("stamp out of range", shown(value))
    if stamp_us < OLDEST_US:
        raise Unusable("stamp before 2000", f"{shown(value)}: let the sender set its clock, or omit `stamp`")
    return stamp_us


def _stamp_us(value: object) -> int:
    if value is None:
        raise Unusable("no stamp", "the message has none where the format says")
    if isinstance(value, str):
        try:
            return parse_stamp(value)
        except InvalidInput:
            pass
        except (ValueError, OverflowError) as error:
            raise Unusable("no stamp", shown(value)) from error
    try:
        number = read_number(value, "stamp")
    except Unusable as error:
        raise Unusable("no stamp", f"{shown(value)}: give it with its offset, or as a number") from error
    size = abs(number)
    scale = 1e6 if size < LARGEST_S else 1e3 if size < LARGEST_MS else 1.0 if size < LARGEST_US else 1e-3
    return round(number * scale)


def object_state(
    instance: str, name: str, value: str, stamp_us: int, attributes: Mapping[str, object] | None = None
) -> NewObjectState:
    return NewObjectState(instance, name, value, to_datetime(stamp_us), attributes or {})


def compass_rad(course_deg: float) -> float:
    """From x (or east) towards y (or north), of degrees clockwise from y (or north)."""
    return math.remainder(math.pi / 2 - math.radians(course_deg), math.tau)


def shown(value: object) -> str:
    """The beginning of a value, for a person."""
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."


Unit = Literal["m", "cm", "mm", "ft", "in"]
METRES: Mapping[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}
