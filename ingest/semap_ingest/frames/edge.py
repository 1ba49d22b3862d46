"""Where one frame was in its parent: the stamped poses of one edge of the tree of frames."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from semap_ingest.frames.rigid import Point, Quaternion, matrix, slerp


class Missing(Enum):
    """Why it is not known where a frame was."""

    UNKNOWN_FRAME = "no transform has named the frame yet"
    NOT_CONNECTED = "the two frames have no ancestor in common"
    TOO_EARLY = "the stamp is before the oldest transform that is kept"
    NOT_YET = "the stamp is after the newest transform"


class Placed(NamedTuple):
    """Where the frame was, and in which parent."""

    parent: str
    translation_m: Point
    quaternion: Quaternion


class Edge:
    """Mutable: poses go in, in any order of their stamps.

    Between two stamps the pose is interpolated; where the parent changed in between, the earlier pose holds
    until the later one, as in tf2. Nothing is said of before the first stamp and after the last. A frame that
    was ever told to be static is at its last static place at all times, whatever else is said.

    parents  how many of its poses are in each parent
    """

    def __init__(self, keep_us: int) -> None:
        self._keep_us = keep_us
        self._stamps: list[int] = []
        self._poses: list[Placed] = []
        self._static: tuple[str, NDArray[np.float64]] | None = None
        self.parents: Counter[str] = Counter()

    def fix(self, placed: Placed) -> None:
        """It is there at all times."""
        self._stamps, self._poses = [], []
        parent_T_child = matrix(placed.translation_m, placed.quaternion)
        parent_T_child.setflags(write=False)  # it is given to many
        self._static = placed.parent, parent_T_child
        self.parents = Counter((placed.parent,))

    def insert(self, stamp_us: int, placed: Placed, needed_us: int | None = None) -> bool:
        """Whether it was kept; of two with one stamp the later said holds.

        needed_us  what is kept reaches back to it at least
        """
        if self._static is not None:
            return False
        place = bisect_left(self._stamps, stamp_us)
        if place < len(self._stamps) and self._stamps[place] == stamp_us:
            self._forget(slice(place, place + 1))
        self._stamps.insert(place, stamp_us)
        self._poses.insert(place, placed)
        self.parents[placed.parent] += 1
        # One pose at or before the horizon stays, so that the whole of what is kept can be answered.
        horizon_us = self._stamps[-1] - self._keep_us
        horizon_us = horizon_us if needed_us is None else min(horizon_us, needed_us)
        outdated = bisect_right(self._stamps, horizon_us) - 1
        if outdated > 0:
            self._forget(slice(0, outdated))
        return place >= outdated

    def span_us(self) -> tuple[int, int] | None:
        """The first and the last stamp that are kept; None where it is static."""
        return (self._stamps[0], self._stamps[-1]) if self._static is None else None

    def parent_at(self, stamp_us: int) -> str:
        """The parent at or next before the stamp; before all stamps, the first."""
        if self._static is not None:
            return self._static[0]
        return self._poses[max(bisect_right(self._stamps, stamp_us) - 1, 0)].parent

    def at(self, stamp_us: int) -> NDArray[np.float64] | Missing:
        """(4, 4) parent_T_child, TOO_EARLY or NOT_YET."""
        if self._static is not None:
            return self._static[1]
        after = bisect_left(self._stamps, stamp_us)
        if after == len(self._stamps):
            return Missing.NOT_YET
        if self._stamps[after] == stamp_us:
            return matrix(*self._poses[after][1:])
        if after == 0:
            return Missing.TOO_EARLY
        start, end = self._poses[after - 1], self._poses[after]
        if start.parent != end.parent:
            return matrix(*start[1:])
        start_us, end_us = self._stamps[after - 1], self._stamps[after]
        fraction = (stamp_us - start_us) / (end_us - start_us)
        (x, y, z), (to_x, to_y, to_z) = start.translation_m, end.translation_m
        between_m = (x + fraction * (to_x - x), y + fraction * (to_y - y), z + fraction * (to_z - z))
        return matrix(between_m, slerp(start.quaternion, end.quaternion, fraction))

    def _forget(self, which: slice) -> None:
        self.parents -= Counter(placed.parent for placed in self._poses[which])
        del self._stamps[which], self._poses[which]
