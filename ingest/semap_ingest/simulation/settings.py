"""What to simulate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from semap.errors import InvalidInput

Sensor = Literal["camera", "laser"]
START_US = 1_767_604_500_000_000
"""Time 0 of a recording: 2026-01-05 09:15 UTC."""

MOST_PEOPLE = 20
LEAST_S = 1.0
LONGEST_S = 3600.0


@dataclass(frozen=True)
class Gap:
    """A sensor is silent from `start_s` on for `length_s`."""

    sensor: Sensor
    start_s: float
    length_s: float

    @classmethod
    def parse(cls, text: str) -> Gap:
        """Read `camera:20:5`: the camera is silent from second 20 on, for 5 s.

        raises InvalidInput if it is not of that form
        """
        sensor, _, times = text.partition(":")
        try:
            start_s, length_s = (float(each) for each in times.split(":"))
            is_time = math.isfinite(start_s) and math.isfinite(length_s) and start_s >= 0 and length_s > 0
        except ValueError:
            is_time = False
        if sensor not in ("camera", "laser") or not is_time:
            raise InvalidInput(
                f"'{text}' is no gap of a sensor",
                "Say which sensor, from which second on and for how many: camera:20:5 or laser:40:2.5.",
            )
        return cls("camera" if sensor == "camera" else "laser", start_s, length_s)

    def covers(self, time_s: float) -> bool:
        return self.start_s <= time_s < self.start_s + self.length_s


@dataclass(frozen=True)
class OfficeSettings:
    """A recording of the office; the same settings give the same recording.

    people      1 to 20; the first six at most change rooms, the others wander
    duration_s  at least 93 s hold 16 changes of rooms; a shorter one has fewer in proportion
    camera      with images; without them it takes a second instead of half a minute
    cloud       with the points of a 3D laser
    wall_cameras, wall_lasers  so many of those of `wall_sensors` besides the robot's: cameras that find boxes
                by themselves
    """

    seed: int = 1
    people: int = 5
    duration_s: float = 93.0
    camera: bool = True
    cloud: bool = False
    gaps: tuple[Gap, ...] = ()
    wall_cameras: int = 0
    wall_lasers: int = 0

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InvalidInput(f"a seed of {self.seed}", "Give a whole number from 0 on.")
        if not 1 <= self.people <= MOST_PEOPLE:
            raise InvalidInput(f"{self.people} people", f"Give a number from 1 to {MOST_PEOPLE}.")
        for what, count, most in (("cameras", self.wall_cameras, 6), ("lasers", self.wall_lasers, 2)):
            if not 0 <= count <= most:
                raise InvalidInput(f"{count} {what} on walls", f"Give a number from 0 to {most}.")
        if not LEAST_S <= self.duration_s <= LONGEST_S:
            raise InvalidInput(
                f"a recording of {self.duration_s} s", f"Give {LEAST_S:.0f} to {LONGEST_S:.0f} seconds."
            )
