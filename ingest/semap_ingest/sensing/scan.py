"""A sweep of a 2D laser, and a cloud of a 3D one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep, in the laser's own frame: x forward, angles counter-clockwise.

    ranges_m    (n,) float32 as the sensor gave them: also 0, infinite or NaN where nothing came back
    range_*_m   what the sensor can measure
    beam_s      from one beam to the next; the stamp is that of the first; 0: all at once, or it is not told
    own_angles_rad  (n,) where the beams are not a step apart from one another; None: they are
    """

    stamp_us: int
    frame: str
    angle_min_rad: float
    angle_step_rad: float
    range_min_m: float
    range_max_m: float
    ranges_m: NDArray[np.float32]
    beam_s: float = 0.0
    own_angles_rad: NDArray[np.float64] | None = None

    @property
    def sweep_us(self) -> int:
        """From the first beam to the last."""
        return round(self.beam_s * max(len(self.ranges_m) - 1, 0) * 1e6)

    @cached_property
    def angles_rad(self) -> NDArray[np.float64]:
        """(n,)"""
        if self.own_angles_rad is not None:
            return self.own_angles_rad
        steps = np.arange(len(self.ranges_m), dtype=np.float64)
        return self.angle_min_rad + self.angle_step_rad * steps

    @cached_property
    def is_return(self) -> NDArray[np.bool_]:
        """(n,), whether something came back."""
        with np.errstate(invalid="ignore"):
            return (self.ranges_m >= self.range_min_m) & (self.ranges_m <= self.range_max_m)

    @cached_property
    def points_m(self) -> NDArray[np.float64]:
        """(n, 2), NaN where nothing came back."""
        ranges = np.where(self.is_return, self.ranges_m, np.nan).astype(np.float64)
        return np.column_stack([ranges * np.cos(self.angles_rad), ranges * np.sin(self.angles_rad)])


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a 3D laser.

    points_m  (n, 3) float32 [m, sensor frame], without those where nothing came back
    """

    stamp_us: int
    frame: str
    points_m: NDArray[np.float32]
