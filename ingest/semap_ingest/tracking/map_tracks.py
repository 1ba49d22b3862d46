"""The tracks of the map tracker: one row each, the same row in all arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.detections import sensor_of
from semap_ingest.tracking.kalman import Gaussians

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
UNCONFIRMED = 0


@dataclass(frozen=True, eq=False)
class MapTracks:
    """n tracks.

    number          (n,) from 1; UNCONFIRMED until initiation is done
    mean            (n, 4) x, y [m, map], vx, vy [m/s]
    covariance      (n, 4, 4)
    begun_m         (n, 2) where it began
    begun_us        (n,)
    seen_us         (n,) stamp of the last detection
    detections      (n,) how many
    looks           (n,) int64, a bit for each look of its last moment in which it was detected
    evidence        (n,) log odds gained since it began (`existence`)
    looked_us       (n, s) when each sensor last looked where it is
    misses          (n,) looks in a row that could have seen it and did not
    frames          (n,) detections within the time that a body sways (`walking`)
    seen_by         (n,) uint8, all kinds of sensors that ever saw it
    hint            (n, s) who it was last to each of s sensors; -1: they never said
    hinted_us       (n, s) when it was
    extent_m        (n, 2) length and width
    extent_m2       (n, 2) variance of both
    heading_rad     (n,) NaN before it has walked
    """

    number: Integers
    mean: Floats
    covariance: Floats
    begun_m: Floats
    begun_us: Integers
    seen_us: Integers
    detections: Integers
    looks: Integers
    evidence: Floats
    looked_us: Integers
    misses: Integers
    frames: Floats
    seen_by: NDArray[np.uint8]
    hint: Integers
    hinted_us: Integers
    extent_m: Floats
    extent_m2: Floats
    heading_rad: Floats

    def __len__(self) -> int:
        return len(self.number)

    @property
    def motion(self) -> Gaussians:
        return Gaussians(self.mean, self.covariance)

    @property
    def is_confirmed(self) -> NDArray[np.bool_]:
        return np.asarray(self.number != UNCONFIRMED, np.bool_)

    def hinted(self, hint: Integers, stamp_us: int) -> MapTracks:
        """The same, and (n,) who each is to a sensor now; -1: it does not say."""
        hints, hinted_us = self.hint.copy(), self.hinted_us.copy()
        rows = np.flatnonzero(hint >= 0)
        hints[rows, sensor_of(hint[rows])] = hint[rows]
        hinted_us[rows, sensor_of(hint[rows])] = stamp_us
        return replace(self, hint=hints, hinted_us=hinted_us)

    def chosen(self, which: NDArray[Any]) -> MapTracks:
        """The rows that a mask or indices name."""
        return MapTracks(**{name: getattr(self, name)[which] for name in _NAMES})

    def joined(self, other: MapTracks) -> MapTracks:
        if not len(other):
            return self
        return MapTracks(
            **{name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _NAMES}
        )

    def replaced(self, rows: Integers, by: MapTracks) -> MapTracks:
        """These rows, ascending, by others."""
        if len(rows) == len(self):
            return by
        arrays = {name: getattr(self, name).copy() for name in _NAMES}
        for name, array in arrays.items():
            array[rows] = getattr(by, name)
        return MapTracks(**arrays)


_NAMES = tuple(field.name for field in fields(MapTracks))


def no_tracks(sensors: int) -> MapTracks:
    """None yet; `sensors` is s of `hint`."""
    none, stamps = np.zeros(0), np.zeros(0, np.int64)
    return MapTracks(
        number=stamps,
        mean=np.zeros((0, 4)),
        covariance=np.zeros((0, 4, 4)),
        begun_m=np.zeros((0, 2)),
        begun_us=stamps,
        seen_us=stamps,
        detections=stamps,
        looks=stamps,
        evidence=none,
        looked_us=np.zeros((0, sensors), np.int64),
        misses=stamps,
        frames=none,
        seen_by=np.zeros(0, np.uint8),
        hint=np.zeros((0, sensors), np.int64),
        hinted_us=np.zeros((0, sensors), np.int64),
        extent_m=np.zeros((0, 2)),
        extent_m2=np.zeros((0, 2)),
        heading_rad=none,
    )
