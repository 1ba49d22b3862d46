"""What stands where it is: posts, legs of tables, edges of open leaves. They look like legs in a single scan.

A cluster that is found at the same place of the map again and again, that does not look like a leg on the
mean over that time, and where nobody is known to be, is a thing. People stand still too: neither one whom a
track is believed to be, nor a cluster that looks like a leg for seconds, is one. Where a thing was is
remembered while something hides it.

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
    person_m    nearer than this to a known person: perhaps its leg, so it tells nothing
    after_us    so long it must have been there
    leg_score   on the mean it looks less than this like a leg
    memory_us   over so long that is a mean
    forgotten_us  so long it must not have been found to be gone
    """

    same_m: float = 0.12
    person_m: float = 0.5
    after_us: int = 3_000_000
    leg_score: float = 0.5
    memory_us: int = 5_000_000
    forgotten_us: int = 2_000_000


def centres_on_map(clusters: LegClusters, map_T_laser: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) [m, map]"""
    return transform_points(map_T_laser, np.pad(clusters.centre_m, ((0, 0), (0, 1))))[:, :2]


class StandingThings:
    """Mutable: places at which something was found, since when, and how much like a leg it looked."""

    def __init__(self, settings: Standing | None = None) -> None:
        self._settings = settings or Standing()
        self._place_m = np.zeros((0, 2))
        self._first_us = np.zeros(0, np.int64)
        self._last_us = np.zeros(0, np.int64)
        self._score = np.zeros(0)

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
        is_thing = (self._score < self._settings.leg_score) & (
            self._last_us - self._first_us >= self._settings.after_us
        )
        near = cdist(centre_m, self._place_m[is_thing]) <= self._settings.same_m
        return np.asarray(near.any(axis=1), np.bool_)

    def learn(
        self,
        stamp_us: int,
        centre_m: NDArray[np.float64],
        score: NDArray[np.float64],
        persons_m: NDArray[np.float64],
    ) -> None:
        """Take in the clusters of a scan.

        centre_m, score  (n, 2), (n,) all of them [m, map]
        persons_m        (k, 2) where persons are known to be
        """
        settings = self._settings
        is_telling = (cdist(centre_m, persons_m) > settings.person_m).all(axis=1)
        distance = cdist(centre_m, self._place_m)
        nearest = distance.argmin(axis=1) if distance.size else np.zeros(len(centre_m), np.int64)
        is_known = (distance <= settings.same_m).any(axis=1)
        told = np.flatnonzero(is_known & is_telling)
        share = np.minimum((stamp_us - self._last_us[nearest[told]]) / settings.memory_us, 1.0)
        self._score[nearest[told]] += share * (score[told] - self._score[nearest[told]])
        self._last_us[nearest[is_known]] = stamp_us
        fresh = np.flatnonzero(is_telling & ~is_known)
        kept = stamp_us - self._last_us <= settings.forgotten_us
        stamps = np.full(len(fresh), stamp_us, np.int64)
        self._place_m = np.concatenate([self._place_m[kept], centre_m[fresh]])
        self._first_us = np.concatenate([self._first_us[kept], stamps])
        self._last_us = np.concatenate([self._last_us[kept], stamps])
        self._score = np.concatenate([self._score[kept], score[fresh]])
