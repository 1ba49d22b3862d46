"""A scan cut into stretches of neighbouring points (jump-distance clustering).

Two neighbouring returns belong together where they are close to each other in space and few beams between
them came back empty. The order is always counter-clockwise, also for a laser that turns the other way; a full
turn is not closed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.scan import Scan

FARTHEST_M = 1000.0
"""What is farther away than any laser sees was not measured."""


@dataclass(frozen=True)
class ClusterSettings:
    """Where a stretch of points ends.

    jump_m      points further apart do not belong together
    jump_beams  the jump allowed grows with range to this many times the distance of neighbouring beams
    gap_rad     of empty beams inside a cluster, at most
    min_points  clusters of fewer points are left out,
    coarse_m    but for one less where beams are farther apart than this: a leg has no room for more
    """

    jump_m: float = 0.13
    jump_beams: float = 2.0
    gap_rad: float = 0.025
    min_points: int = 3
    coarse_m: float = 0.03


@dataclass(frozen=True, eq=False)
class ScanClusters:
    """Clusters of one scan, counter-clockwise.

    points_m  (p, 2) everything that came back, also what is in no cluster [m, laser]
    range_m   (p,)
    beam      (p,) int64, which beam of the scan
    first     (n,) int64; cluster k is points_m[first[k]:stop[k]]
    stop      (n,) int64
    """

    points_m: NDArray[np.float64]
    range_m: NDArray[np.float64]
    beam: NDArray[np.int64]
    first: NDArray[np.int64]
    stop: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.first)

    @cached_property
    def count(self) -> NDArray[np.int64]:
        """(n,), how many points."""
        return self.stop - self.first

    @cached_property
    def offset(self) -> NDArray[np.int64]:
        """(n,), where the members of each cluster begin among all members."""
        return np.cumsum(self.count) - self.count

    @cached_property
    def member(self) -> NDArray[np.int64]:
        """(m,) indices of points_m that are in a cluster, cluster after cluster."""
        return np.repeat(self.first - self.offset, self.count) + np.arange(self.count.sum())

    @cached_property
    def cluster_of(self) -> NDArray[np.int64]:
        """(m,) the cluster of each member."""
        return np.repeat(np.arange(len(self)), self.count)

    def total(self, of_member: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, ...) sum over each cluster of a value (m, ...) of its members."""
        if not len(self):
            return np.zeros((0, *of_member.shape[1:]))
        return np.add.reduceat(of_member, self.offset, axis=0)

    def mean(self, of_member: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, ...) mean over each cluster of a value (m, ...) of its members."""
        return self.total(of_member) / self.count.reshape(-1, *[1] * (of_member.ndim - 1))


def beams_that_hit(scan: Scan) -> NDArray[np.int64]:
    """(p,) those with a range that can be one, counter-clockwise; none of a scan whose angles are unknown.

    A laser that turns the other way has a negative step. Some drivers give 0 or infinity for nothing, and a
    least or greatest range that lets that pass.
    """
    if not (np.isfinite(scan.angle_min_rad) and np.isfinite(scan.angle_step_rad)):
        return np.empty(0, np.int64)
    is_range = (scan.ranges_m > 0) & (scan.ranges_m < FARTHEST_M)
    beam = np.flatnonzero(scan.is_return & is_range)
    return beam[::-1] if scan.angle_step_rad < 0 else beam


def find_clusters(scan: Scan, settings: ClusterSettings = ClusterSettings()) -> ScanClusters:
    """Cut a scan where its points jump. A scan without returns gives no clusters."""
    beam = beams_that_hit(scan)
    range_m = scan.ranges_m[beam].astype(np.float64)
    angle_rad = scan.angles_rad[beam]
    points = range_m[:, None] * np.column_stack([np.cos(angle_rad), np.sin(angle_rad)])
    step_rad = abs(scan.angle_step_rad)

    distance = np.hypot(*np.diff(points, axis=0).T)
    allowed = np.maximum(
        settings.jump_m, settings.jump_beams * step_rad * np.minimum(range_m[1:], range_m[:-1])
    )
    empty_rad = (np.abs(np.diff(beam)) - 1) * step_rad
    is_cut = (distance > allowed) | (empty_rad > settings.gap_rad)

    bounds = np.concatenate([[0], np.flatnonzero(is_cut) + 1, [len(beam)]]).astype(np.int64)
    first, stop = bounds[:-1], bounds[1:]
    is_coarse = np.append(range_m, 0.0)[first] * step_rad > settings.coarse_m
    least = settings.min_points - is_coarse
    is_kept = stop - first >= np.maximum(least, 1)
    return ScanClusters(points, range_m, beam, first[is_kept], stop[is_kept])
