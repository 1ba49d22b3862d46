"""ESPresense-companion: positions of phones and tags, in metres of its own floor plan.

It writes espresense/companion/ID with the name of a room or not_home, and .../attributes with the position.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import Field

from semap_bridge.messages.template import Reading
from semap_bridge.messages.told import (
    NOTHING,
    Located,
    Message,
    Told,
    read_json,
    read_name,
    read_number,
    read_object,
    read_optional,
    read_stamp,
)

AWAY = b"not_home"


class Espresense(Reading):
    format: Literal["espresense"]
    topic: str = Field(default="espresense/companion/{device}/#", description="With a part {device}.")
    std_m: float | None = Field(default=1.5, ge=0, description="Standard deviation of its positions [m].")

    @property
    def is_kept(self) -> bool:
        """Not all of its messages are stamped."""
        return False

    def _read(self, message: Message, parts: Mapping[str, str]) -> Told:
        device = self._named(read_name(parts.get("device"), "device"))
        if not message.topic.endswith("/attributes"):
            is_gone = message.payload == AWAY and not message.is_retained
            return Told(ended=[(device, message.came_us)]) if is_gone else NOTHING
        said = read_object(read_json(message.payload))
        if "last_seen" not in said and message.is_retained:
            return NOTHING  # nobody knows how old it is
        return Told(
            [
                Located(
                    device,
                    read_stamp(said["last_seen"]) if "last_seen" in said else message.came_us,
                    read_number(said.get("x"), "x"),
                    read_number(said.get("y"), "y"),
                    read_optional(said.get("z"), "z"),
                    self.std_m,
                )
            ]
        )
