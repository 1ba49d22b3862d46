"""Which detection is of which track: by place, by how credible each is, and by the sensor's hint.

The cost of a pair is minus twice the log of how much more likely it is that the detection is of the
track's person than that the person was missed and the detection is of somebody new, or of nobody
(Blackman and Popoli 1999, ch. 6):

    detected * N(position) * score
        against  (1 - detected) * (new_per_m2 * score + false_per_m2 * (1 - score))

with N the normal density where the track is expected. The longer a person was not seen, the less likely
it is that it is seen now; where the sensor does not look, it is hardly seen. Odds of the hint (who it
is to the sensor itself, such as an image track) come on top. Where the cost is not below zero, or the
detection outside of the gate, no pair is made.

A track may have slipped from its person's legs to what stands beside them, a post or the edge of a leaf. So
the detection that has its hint may lie outside of the gate: then the place of the track is taken to
be less certain by `slip_m`, and such a pair says that it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.detections import Detections, sensor_of
from semap_ingest.tracking.assignment import Indices, assign
from semap_ingest.tracking.deletion import Patience, rests
from semap_ingest.tracking.kalman import Distances, distances
from semap_ingest.tracking.map_tracks import MapTracks

Floats = NDArray[np.float64]
RESTING_US = 500_000
"""Unseen for longer, who stands out of sight is no less likely there."""


@dataclass(frozen=True)
class Association:
    """What decides between tracks.

    gate                   Mahalanobis distance squared, 0.999 of chi-square with two degrees of freedom
    new_per_m2             persons in a frame that no track knows
    false_per_m2           detections in a frame of what is no person
    unconfirmed            how much less likely the person of such a track is detected, seen just now
    out_of_sight           the same where the sensor does not look: tracks are beside their persons
    hidden_s               time unseen in which that falls to 1/e
    same_hint              log odds when the detection has the hint that the track had of that sensor
    other_hint             log odds, against, when it has another one
    taken_hint             log odds, against, when another track had it
    slip_m                 how far a track may have slipped, as a standard deviation
    rival_margin           two tracks were rivals where exchanging their detections, or giving the one's to
                           the other that has none, would have cost at most so much more, by place alone
    """

    gate: float = 13.8
    new_per_m2: float = 0.02
    false_per_m2: float = 0.1
    unconfirmed: float = 0.5
    out_of_sight: float = 0.05
    hidden_s: float = 1.5
    same_hint: float = 3.0
    other_hint: float = 1.0
    taken_hint: float = 2.0
    slip_m: float = 0.3
    rival_margin: float = 14.0


@dataclass(frozen=True, eq=False)
class Pairs:
    """Rows of tracks and of the detections that are theirs, and which tracks could be mistaken.

    has_slipped  of each pair: the track had been beside its person
    rivals       (r, 2) rows of tracks; the first has a detection, for which no hint spoke
    """

    track: Indices
    detection: Indices
    has_slipped: NDArray[np.bool_]
    rivals: Indices


def associate(
    tracks: MapTracks,
    detections: Detections,
    covariance_m2: Floats,
    settings: Association,
    patience: Patience,
) -> Pairs:
    """Pairs of tracks and detections.

    tracks         as they are expected at the stamp of the detections
    covariance_m2  (n, m, 2, 2) of each detection as a measurement of each track
    """
    distance = distances(tracks.motion, detections.position_m, covariance_m2)
    unseen_us = detections.stamp_us - tracks.seen_us
    sensor = sensor_of(detections.hint)
    hint = tracks.hint[:, sensor]
    is_recent = detections.stamp_us - tracks.hinted_us[:, sensor] <= patience.by_hint_us
    is_hinted = (hint >= 0) & is_recent & (detections.hint >= 0)
    is_same = is_hinted & (hint == detections.hint)
    slipped = is_same & (distance.squared > settings.gate)
    if slipped.any():
        slip_m2 = settings.slip_m**2 * np.eye(2)
        wider = distances(tracks.motion, detections.position_m, covariance_m2 + slip_m2)
        distance = Distances(
            np.where(slipped, wider.squared, distance.squared),
            np.where(slipped, wider.log_determinant, distance.log_determinant),
        )
    is_resting = rests(tracks, detections.stamp_us, patience)
    unseen_us = np.where(is_resting, np.minimum(unseen_us, RESTING_US), unseen_us)
    is_kept = (unseen_us <= patience.confirmed_us) | is_resting
    can_be = (distance.squared <= settings.gate) & (is_kept[:, None] | is_same)
    by_place = np.where(can_be, distance.squared + distance.log_determinant, np.inf)
    cost = by_place + 2 * math.log(2 * math.pi)
    cost -= 2 * _detection_log_odds(tracks, unseen_us, detections, settings)[:, None]
    cost -= 2 * np.log(_person_odds(detections.score, settings))
    cost -= 2 * _hint_log_odds(is_same, is_hinted, settings)
    rows, columns = assign(cost, 0.0)
    extra = np.where(detections.hint[columns] < 0, _extra(by_place, rows, columns), np.inf)
    other, pair = np.nonzero(extra <= settings.rival_margin)
    return Pairs(rows, columns, slipped[rows, columns], np.column_stack([rows[pair], other]))


def _detection_log_odds(
    tracks: MapTracks, unseen_us: Indices, detections: Detections, settings: Association
) -> Floats:
    """(n,) that the person is detected rather than missed"""
    at_once = detections.detected * np.where(tracks.is_confirmed, 1.0, settings.unconfirmed)
    at_once *= np.where(detections.sight.reaches(tracks.mean[:, :2]), 1.0, settings.out_of_sight)
    log_detected = np.log(at_once) - unseen_us / (settings.hidden_s * 1e6)
    return np.asarray(log_detected - np.log1p(-np.exp(log_detected)), np.float64)


def _person_odds(score: Floats, settings: Association) -> Floats:
    """(m,) of its being of a known person rather than of a new one or nobody [m^2]"""
    others_per_m2 = settings.new_per_m2 * score + settings.false_per_m2 * (1 - score)
    return np.asarray(np.maximum(score, 1e-6) / others_per_m2, np.float64)


def _hint_log_odds(is_same: NDArray[np.bool_], is_hinted: NDArray[np.bool_], settings: Association) -> Floats:
    """(n, m)"""
    differs = is_hinted & ~is_same
    is_taken = is_same.any(axis=0) & ~is_same
    log_odds = settings.same_hint * is_same - settings.other_hint * differs
    return np.asarray(log_odds - settings.taken_hint * is_taken, np.float64)


def _extra(by_place: Floats, rows: Indices, columns: Indices) -> Floats:
    """(n, k) how much more it would cost if track n had the detection of pair k, and the track of that pair
    what n has, if anything; infinite for itself.
    """
    extra = by_place[:, columns] - by_place[rows, columns]
    extra[rows] += extra[rows].T
    extra[rows, np.arange(len(rows))] = np.inf
    return extra
