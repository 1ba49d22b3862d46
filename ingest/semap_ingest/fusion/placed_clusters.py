"""Leg clusters of a scan, in the map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.clusters import LegClusters

LEAST_SCORE = 0.01
BOTH_IN_ONE_M = 0.3
FARTHEST_M = 1000.0


@dataclass(frozen=True, eq=False)
class PlacedClusters:
    """Those of the scan whose place and covariance are numbers that can be.

    position_m     (n, 3) [m, map]
    covariance_m2  (n, 2, 2) along x and y of the map
    score          (n,) as in the scan, 0 where it is not a number
    log_odds       (n,) of the score, bounded
    is_wide        (n,) wider than one leg: both in one
    source         (n,) int64, places in the scan's clusters
    """

    position_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    score: NDArray[np.float64]
    log_odds: NDArray[np.float64]
    is_wide: NDArray[np.bool_]
    source: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.position_m)

    def middle(
        self, left: NDArray[np.int64], right: NDArray[np.int64], std_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The middle between two legs and its covariance with the body's sway (`std_m` along each axis)."""
        position = (self.position_m[left, :2] + self.position_m[right, :2]) / 2
        covariance = (self.covariance_m2[left] + self.covariance_m2[right]) / 4
        return position, covariance + std_m**2 * np.eye(2)


def place_clusters(
    clusters: LegClusters, map_T_laser: NDArray[np.float64], moved_std_m: float
) -> PlacedClusters:
    """moved_std_m  along each axis, how far a person may have gone between scan and moment"""
    with np.errstate(invalid="ignore"):
        has_place = (np.abs(clusters.centre_m) < FARTHEST_M).all(axis=1)
    source = np.flatnonzero(has_place & np.isfinite(clusters.covariance_m2).all(axis=(1, 2)))
    map_T_laser = np.asarray(map_T_laser, dtype=np.float64)
    turn = map_T_laser[:3, :2]
    position = clusters.centre_m[source] @ turn.T + map_T_laser[:3, 3]
    covariance = turn[:2] @ clusters.covariance_m2[source] @ turn[:2].T + moved_std_m**2 * np.eye(2)
    score = clusters.score[source]
    score = np.where(np.isfinite(score), score, 0.0)
    bounded = np.clip(score, LEAST_SCORE, 1 - LEAST_SCORE)
    return PlacedClusters(
        position,
        covariance,
        score,
        np.log(bounded / (1 - bounded)),
        np.asarray(clusters.width_m[source] > BOTH_IN_ONE_M),
        source,
    )
