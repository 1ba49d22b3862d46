"""Where the robot itself is: a track, at the moments up to which its sensors are understood.

So its source is never behind the others, and rules wait for nothing of it. Where no sensor is heard, each
transform is such a moment.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray
from semap_ingest.frames.transform_buffer import Missing, TransformBuffer
from semap_ingest.named_states import NO_STATES, NamedStates
from semap_ingest.sensing.transform import Transform

from semap_bridge.adapter import Batch

PERIOD_US = 100_000
"""No two states of it are nearer to one another."""
MOST_WAITING = 100


class Robot:
    """Mutable: its transforms, and the moments at which its place is not known yet.

    frame       its own; source: of its track
    """

    def __init__(self, map_frame: str, frame: str, name: str, source: str) -> None:
        self._map_frame, self._frame = map_frame, frame
        self._name, self._source = name, source
        self._transforms = TransformBuffer()
        self._waiting: deque[int] = deque(maxlen=MOST_WAITING)
        self._last_us = 0
        self._told_us = 0

    def add(self, transform: Transform) -> None:
        """raises InvalidInput for one that is none"""
        self._transforms.add(transform)

    def at(self, stamp_us: int) -> list[Batch]:
        """What is known of its place up to a moment."""
        if stamp_us <= self._last_us:
            return self._known()
        self._last_us = stamp_us
        self._waiting.append(stamp_us)
        return self._known()

    def why_missing(self, stamp_us: int) -> str:
        return self._transforms.why_missing(self._map_frame, self._frame, stamp_us)

    def _known(self) -> list[Batch]:
        batches = []
        while self._waiting:
            stamp_us = self._waiting[0]
            found = self._transforms.lookup(self._map_frame, self._frame, stamp_us)
            if found is Missing.NOT_YET:
                break
            self._waiting.popleft()
            states = NO_STATES
            if not isinstance(found, Missing) and stamp_us - self._told_us >= PERIOD_US:
                self._told_us = stamp_us
                states = _state(self._name, stamp_us, found)
            if self._told_us:  # else there is no such source yet
                batches.append(Batch(states, watermark_us=stamp_us, source=self._source))
        return batches


def _state(name: str, stamp_us: int, map_T_robot: NDArray[np.float64]) -> NamedStates:
    x_m, y_m, z_m = map_T_robot[:3, 3]
    heading_rad = math.atan2(map_T_robot[1, 0], map_T_robot[0, 0])
    return NamedStates.of_columns(
        [name], [stamp_us], x_m=[x_m], y_m=[y_m], z_m=[z_m], heading_rad=[heading_rad]
    )
