"""The tracks of the map tracker: one row each, the same row in all arrays."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    points          (n, k) uint8, what the last k frames gave towards confirmation, the newest first
    score           (n,) mean of its detections' scores, the latest counting more
    seen_by         (n,) uint8, all sensors that ever saw it
    image_track     (n,) the last image track that was its; -1: none
    image_seen_us   (n,) when it was
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
    points: NDArray[np.uint8]
    score: Floats
    seen_by: NDArray[np.uint8]
    image_track: Integers
    image_seen_us: Integers
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


def no_tracks(frames: int) -> MapTracks:
    """None yet; `frames` is k of `points`."""
    none, stamps = np.zeros(0), np.zeros(0, np.int64)
    return MapTracks(
        number=stamps,
        mean=np.zeros((0, 4)),
        covariance=np.zeros((0, 4, 4)),
        begun_m=np.zeros((0, 2)),
        begun_us=stamps,
        seen_us=stamps,
        detections=stamps,
        points=np.zeros((0, frames), np.uint8),
        score=none,
        seen_by=np.zeros(0, np.uint8),
        image_track=stamps,
        image_seen_us=stamps,
        extent_m=np.zeros((0, 2)),
        extent_m2=np.zeros((0, 2)),
        heading_rad=none,
    )
