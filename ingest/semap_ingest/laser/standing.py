"""What stands where it is: posts, legs of tables, edges of open leaves. They look like legs in a single scan.

A cluster that is found at the same place of the map again and again, and that no camera takes for a person,
is a thing. People stand still too: one whom the camera does not see is taken for a thing after `after_us`,
until it moves; one whom it sees never is.

No clock, no I/O: the stamps of scans alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from semap.geometry.pose import transform_points
from semap_ingest.sensing.clusters import LegClusters


@dataclass(frozen=True)
class Standing:
    """What makes a cluster a thing.

    same_m      no farther than this from where it was: the same
    person_m    nearer than this to a person whom a camera sees: perhaps its leg, so it tells nothing
    after_us    so long it must have been there
    hits        and so often it must have been found
    forgotten_us  so long it must not have been found to be gone
    """

    same_m: float = 0.12
    person_m: float = 0.5
    after_us: int = 3_000_000
    hits: int = 20
    forgotten_us: int = 2_000_000


def centres_on_map(clusters: LegClusters, map_T_laser: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) [m, map]"""
    return transform_points(map_T_laser, np.pad(clusters.centre_m, ((0, 0), (0, 1))))[:, :2]


class StandingThings:
    """Mutable: places at which something was found, with when and how often."""

    def __init__(self, settings: Standing | None = None) -> None:
        self._settings = settings or Standing()
        self._place_m = np.zeros((0, 2))
        self._first_us = np.zeros(0, np.int64)
        self._last_us = np.zeros(0, np.int64)
        self._hits = np.zeros(0, np.int64)

    def without(self, clusters: LegClusters, map_T_laser: NDArray[np.float64]) -> LegClusters:
        """The clusters of a scan that are no things, as far as is known by now."""
        kept = np.flatnonzero(~self.are_things(centres_on_map(clusters, map_T_laser)))
        return replace(
            clusters,
            centre_m=clusters.centre_m[kept],
            covariance_m2=clusters.covariance_m2[kept],
            score=clusters.score[kept],
            width_m=clusters.width_m[kept],
            points=clusters.points[kept],
        )

    def are_things(self, centre_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of these clusters are things, by what was found before.

        centre_m  (n, 2) [m, map]
        """
        is_thing = (self._hits >= self._settings.hits) & (
            self._last_us - self._first_us >= self._settings.after_us
        )
        near = cdist(centre_m, self._place_m[is_thing]) <= self._settings.same_m
        return np.asarray(near.any(axis=1), np.bool_)

    def learn(self, stamp_us: int, centre_m: NDArray[np.float64], persons_m: NDArray[np.float64]) -> None:
        """Take in the clusters of a scan.

        centre_m   (n, 2) all of them [m, map]
        persons_m  (k, 2) where persons are whom a camera sees
        """
        settings = self._settings
        is_telling = (cdist(centre_m, persons_m) > settings.person_m).all(axis=1)
        distance = cdist(centre_m, self._place_m)
        nearest = distance.argmin(axis=1) if distance.size else np.zeros(len(centre_m), np.int64)
        is_known = (distance <= settings.same_m).any(axis=1)
        known = np.unique(nearest[is_known])
        self._last_us[known] = stamp_us
        self._hits[np.unique(nearest[is_known & is_telling])] += 1
        fresh = centre_m[is_telling & ~is_known]
        kept = stamp_us - self._last_us <= settings.forgotten_us
        stamps = np.full(len(fresh), stamp_us, np.int64)
        self._place_m = np.concatenate([self._place_m[kept], fresh])
        self._first_us = np.concatenate([self._first_us[kept], stamps])
        self._last_us = np.concatenate([self._last_us[kept], stamps])
        self._hits = np.concatenate([self._hits[kept], np.ones(len(fresh), np.int64)])
