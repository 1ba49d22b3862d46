"""What stirs in its place: people who stand sway and shift their weight, and things do not.

In a few seconds a leg goes a centimetre and more to and fro. So before a laser that stands, a cluster that
stirs by more than its noise is more likely a leg than its shape tells, and one that has not stirred for long
is less. Noise is what differs from scan to scan (the mean square successive difference of von Neumann 1941),
stirring what is left of the variance over the last seconds. Where noise hides it, and while the laser moves,
nothing is said. Since things betray themselves, what looks like a leg is believed sooner before a laser that
stands.

No clock, no I/O: the stamps of scans alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from semap_ingest.sensing.clusters import LegClusters

Floats = NDArray[np.float64]
STANDS_US = 4_000_000
"""After so long where it is, a laser stands."""


@dataclass(frozen=True)
class Stir:
    """How much stirs, and what that says.

    same_m           no farther than this from its place: the same
    memory_us        over so long is the variance
    jump_m           more than so far off counts as so much: a neighbour has hidden a part of it
    still_m, stirs_m  up to the one it does not stir at all, from the other on it surely does
    stands_log_odds  added to those of a leg before a laser that stands
    still_log_odds, stirs_log_odds  what not to stir, and to stir, adds to that
    stirs_after_us   so long it must have been there for stirring to count
    still_from_us, still_after_us  when stillness begins to count, and when it counts in full
    moved_m, turned_rad  by more than this the laser has moved
    forgotten_us     so long unseen, a place is none
    """

    same_m: float = 0.12
    memory_us: int = 8_000_000
    jump_m: float = 0.03
    still_m: float = 0.002
    stirs_m: float = 0.006
    stands_log_odds: float = 0.44
    still_log_odds: float = -4.0
    stirs_log_odds: float = 0.85
    stirs_after_us: int = 3_000_000
    still_from_us: int = 4_000_000
    still_after_us: int = 16_000_000
    moved_m: float = 0.02
    turned_rad: float = 0.004
    forgotten_us: int = 2_000_000


class Stirring:
    """Mutable: where clusters are found again, since when, and how they move there."""

    def __init__(self, settings: Stir | None = None) -> None:
        self._settings = settings or Stir()
        self._stood_at, self._stood_from_us = np.full((4, 4), np.nan), 0
        self._forget()

    def scores(self, clusters: LegClusters, map_T_laser: Floats) -> Floats:
        """(n,) as the clusters' own, by what their places did until now."""
        if self._has_moved(map_T_laser):
            self._stood_at, self._stood_from_us = np.array(map_T_laser, np.float64), clusters.stamp_us
            self._forget()
        place = self._places_of(clusters)
        known = np.flatnonzero(place >= 0)
        self._learn(place[known], clusters.centre_m[known], clusters.stamp_us)
        stood_us = clusters.stamp_us - self._stood_from_us
        log_odds = np.full(len(clusters), self._settings.stands_log_odds if stood_us > STANDS_US else 0.0)
        log_odds[known] += self._log_odds(place[known], clusters.stamp_us)
        self._renew(clusters.centre_m[place < 0], clusters.stamp_us)
        odds = clusters.score * np.exp(log_odds)
        return np.asarray(odds / (odds + 1 - clusters.score), np.float64)

    def _has_moved(self, map_T_laser: Floats) -> bool:
        moved_m = np.linalg.norm(map_T_laser[:3, 3] - self._stood_at[:3, 3])
        turned = np.trace(self._stood_at[:3, :3].T @ map_T_laser[:3, :3])
        turned_rad = np.arccos(np.clip((turned - 1) / 2, -1.0, 1.0))
        # not a number at first
        return not (moved_m <= self._settings.moved_m and turned_rad <= self._settings.turned_rad)

    def _forget(self) -> None:
        self._first_us = self._last_us = np.zeros(0, np.int64)
        self._looks = np.zeros(0)
        self._mean_m = self._latest_m = np.zeros((0, 2))
        self._variance_m2 = self._noise_m2 = np.zeros(0)

    def _places_of(self, clusters: LegClusters) -> NDArray[np.int64]:
        """(n,) the known place of each cluster, which is the only one there; else -1."""
        place = np.full(len(clusters), -1)
        if len(clusters) and len(self._mean_m):
            away_m = cdist(clusters.centre_m, self._mean_m)
            nearest, closest = away_m.argmin(axis=1), away_m.argmin(axis=0)
            rows = np.arange(len(clusters))
            is_same = (closest[nearest] == rows) & (away_m[rows, nearest] <= self._settings.same_m)
            place[is_same] = nearest[is_same]
        return place

    def _learn(self, place: NDArray[np.int64], centre_m: Floats, stamp_us: int) -> None:
        looks = self._looks[place] + 1
        share = np.maximum((stamp_us - self._last_us[place]) / self._settings.memory_us, 1 / looks)
        off_m = centre_m - self._mean_m[place]
        off_m *= np.minimum(1.0, self._settings.jump_m / np.maximum(np.linalg.norm(off_m, axis=1), 1e-9))[
            :, None
        ]
        hop_m2 = np.minimum(
            ((centre_m - self._latest_m[place]) ** 2).sum(axis=1), 4 * self._settings.jump_m**2
        )
        self._variance_m2[place] += share * ((1 - share) * (off_m**2).sum(axis=1) - self._variance_m2[place])
        self._noise_m2[place] += share * (hop_m2 / 2 - self._noise_m2[place])
        self._mean_m[place] += share[:, None] * off_m
        self._latest_m[place], self._last_us[place], self._looks[place] = centre_m, stamp_us, looks

    def _log_odds(self, place: NDArray[np.int64], stamp_us: int) -> Floats:
        settings = self._settings
        there_us = stamp_us - self._first_us[place]
        looks = self._looks[place] * np.minimum(1.0, settings.memory_us / np.maximum(there_us, 1))
        stirring_m2 = np.maximum(self._variance_m2[place] - self._noise_m2[place], 0.0)
        # of the difference between two estimates of the variance of the same white noise on two axes
        std_m2 = self._noise_m2[place] / np.sqrt(2 * looks)
        middle_m, half_m = (
            (settings.stirs_m + settings.still_m) / 2,
            (settings.stirs_m - settings.still_m) / 2,
        )
        at_least = np.clip((np.sqrt(np.maximum(stirring_m2 - std_m2, 0.0)) - middle_m) / half_m, 0.0, 1.0)
        at_most = np.clip((middle_m - np.sqrt(stirring_m2 + std_m2)) / half_m, 0.0, 1.0)
        stirs = np.where(there_us >= settings.stirs_after_us, settings.stirs_log_odds, 0.0)
        lasts = (there_us - settings.still_from_us) / (settings.still_after_us - settings.still_from_us)
        still = settings.still_log_odds * np.clip(lasts, 0.0, 1.0)
        return np.asarray(at_least * stirs + at_most * still, np.float64)

    def _renew(self, fresh_m: Floats, stamp_us: int) -> None:
        """Without the places where nothing was for long, and with new ones."""
        kept = stamp_us - self._last_us <= self._settings.forgotten_us
        stamps, zeros = np.full(len(fresh_m), stamp_us, np.int64), np.zeros(len(fresh_m))
        self._first_us = np.concatenate([self._first_us[kept], stamps])
        self._last_us = np.concatenate([self._last_us[kept], stamps])
        self._looks = np.concatenate([self._looks[kept], zeros + 1])
        self._mean_m = np.concatenate([self._mean_m[kept], fresh_m])
        self._latest_m = np.concatenate([self._latest_m[kept], fresh_m])
        self._variance_m2 = np.concatenate([self._variance_m2[kept], zeros])
        self._noise_m2 = np.concatenate([self._noise_m2[kept], zeros])
