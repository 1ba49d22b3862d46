"""Frigate: what it tracks in the pictures of cameras, kept as it comes; boxes of persons, where a rig says
where its cameras hang."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field

from semap_bridge.config import ConfigPath
from semap_bridge.messages.template import Reading
from semap_bridge.messages.told import (
    CameraBox,
    CameraReport,
    Message,
    Told,
    Unusable,
    read_json,
    read_name,
    read_number,
    read_object,
    read_optional,
    read_stamp,
    shown,
)

LONGEST = 100
PERSON = "person"


class Frigate(Reading):
    format: Literal["frigate"]
    topic: str = Field(default="frigate/events", description="Where Frigate writes its events.")
    rig: ConfigPath | None = Field(
        default=None,
        description="File that places its cameras, by their names in Frigate. [default: boxes are only kept]",
    )
    kept_s: float = Field(
        default=10.0, gt=0, le=3600, description="A person of whom it says nothing for so long is gone [s]."
    )

    def _read(self, message: Message, parts: Mapping[str, str]) -> Told:
        said = read_object(read_json(message.payload))
        if said.get("type") not in ("new", "update", "end"):
            raise Unusable("no event of Frigate", f"type is {shown(said.get('type'))}: new, update or end")
        after = read_object(said.get("after"), "after")
        _require_storable(said)
        camera = self._named(read_name(after.get("camera"), "camera", LONGEST))
        known_as = read_name(after.get("id"), "id", LONGEST)
        stamp_us = read_stamp(after.get("frame_time"))
        report = CameraReport(camera, known_as, stamp_us, said)
        if said["type"] == "end":  # its picture is an old one
            return Told(reports=[report], unseen=[(camera, known_as)])
        if self.rig is None or after.get("label") != PERSON or after.get("false_positive") is True:
            return Told(reports=[report])
        try:
            box = CameraBox(camera, known_as, stamp_us, *_box_and_score(after), PERSON)
        except Unusable as error:
            return Told(reports=[report], unusable=[error.of(camera)])
        return Told(reports=[report], boxes=[box])


def _box_and_score(after: Mapping[str, Any]) -> tuple[tuple[float, float, float, float], float]:
    said = after.get("box")
    if not isinstance(said, list) or len(said) != 4:
        raise Unusable("no box", shown(said))
    x_min, y_min, x_max, y_max = (read_number(each, "box") for each in said)
    if x_max <= x_min or y_max <= y_min:
        raise Unusable("no box", shown(said))
    score = read_optional(after.get("score"), "score")
    return (x_min, y_min, x_max, y_max), 1.0 if score is None else min(max(score, 0.0), 1.0)


def _require_storable(document: Mapping[str, Any]) -> None:
    """What PostgreSQL's jsonb does not take: numbers that are none, null characters, halves of characters."""
    try:
        written = json.dumps(document, ensure_ascii=False, allow_nan=False)
        written.encode()
    except (ValueError, RecursionError) as error:
        raise Unusable("not to be stored", str(error)) from error
    if "\\u0000" in written:
        raise Unusable("not to be stored", "it has a null character")
