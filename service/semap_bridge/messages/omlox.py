"""omlox: locations in JSON as its hub writes them: one, a list, or in the envelope of its WebSocket.

A location is local, in metres of its zone, or on earth (EPSG:4326); a trackable's id names it before its
provider's does. Course and heading are clockwise from north, which is y of a zone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from semap_bridge.messages.template import Reading
from semap_bridge.messages.told import (
    Located,
    Message,
    Told,
    Unusable,
    compass_rad,
    read_json,
    read_name,
    read_number,
    read_object,
    read_optional,
    read_stamp,
    shown,
)

EARTH = ("EPSG:4326", "4326")


class Omlox(Reading):
    format: Literal["omlox"]

    def _read(self, message: Message, parts: Mapping[str, str]) -> Told:
        return self.of(read_json(message.payload), message.came_us)

    def of(self, value: object, came_us: int) -> Told:
        """raises  Unusable where it is no location, and no list of them"""
        if isinstance(value, Mapping) and "payload" in value:
            value = value["payload"]
        located: list[Located] = []
        unusable: list[Unusable] = []
        for each in value if isinstance(value, list) else [value]:
            try:
                located.append(self._located(read_object(each, "location"), came_us))
            except Unusable as error:
                unusable.append(error)
        return Told(located, unusable=unusable)

    def _located(self, said: Mapping[str, Any], came_us: int) -> Located:
        position = read_object(said.get("position"), "position")
        coordinates = position.get("coordinates")
        if not isinstance(coordinates, list) or len(coordinates) not in (2, 3):
            raise Unusable("position is no point", shown(coordinates))
        x, y, *z = (read_number(each, "coordinate") for each in coordinates)
        crs = said.get("crs") or "local"
        if crs != "local" and crs not in EARTH:
            raise Unusable("unknown crs", f"{shown(crs)}: local and EPSG:4326 are read")
        stamp = said.get("timestamp_generated") or said.get("timestamp_sent")
        accuracy = read_optional(said.get("accuracy"), "accuracy")
        heading = read_optional(said.get("true_heading"), "true_heading")
        if heading is None or heading < 0:
            heading = read_optional(said.get("course"), "course")
        speed = read_optional(said.get("speed"), "speed")
        return Located(
            self._named(_name(said)),
            came_us if stamp is None else read_stamp(stamp),
            x,
            y,
            z[0] if z and said.get("elevation_ref") != "wgs84" else None,
            self.std_m if accuracy is None or accuracy < 0 else accuracy,
            None if heading is None else compass_rad(heading),
            None if speed is None or speed < 0 else speed,
            crs != "local",
        )


def _name(said: Mapping[str, Any]) -> str:
    trackables = said.get("trackables")
    if isinstance(trackables, list) and trackables:
        return read_name(trackables[0], "trackable")
    return read_name(said.get("provider_id"), "provider_id")
