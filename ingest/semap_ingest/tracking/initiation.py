"""How a track begins, and when it is believed.

A detection that no track explains begins one. It is believed when the evidence for a person suffices
(`existence`), after two detections at the earliest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.detections import Detections
from semap_ingest.tracking.assignment import Indices
from semap_ingest.tracking.detection_rows import chosen
from semap_ingest.tracking.existence import Existence, first_evidence, probability
from semap_ingest.tracking.footprint import Body, first_extent
from semap_ingest.tracking.map_tracks import UNCONFIRMED, MapTracks
from semap_ingest.tracking.walking import Walking


@dataclass(frozen=True)
class Initiation:
    """Which detections may begin a track.

    apart_m      nearer to a track that was seen in the same frame nobody else can stand
    least_score  what is less credible goes on with tracks and begins none
    """

    apart_m: float = 0.3
    least_score: float = 0.3


def begin(
    detections: Detections,
    near_m: NDArray[np.float64],
    look: int,
    sensors: int,
    settings: Initiation,
    existence: Existence,
    walking: Walking,
    body: Body,
) -> MapTracks:
    """New tracks of detections that are of none.

    near_m  (k, 2) the tracks that were detected in this look: what is too near to one is a part of it
    look    the how-manieth of its moment; sensors: how many may give hints
    """
    detections = chosen(detections, detections.score >= settings.least_score)
    detections = chosen(detections, _apart(detections, near_m, settings.apart_m))
    count = len(detections)
    stamp = np.full(count, detections.stamp_us, np.int64)
    covariance = np.zeros((count, 4, 4))
    covariance[:, :2, :2] = detections.covariance_m2 + walking.stance_std_m**2 * np.eye(2)
    covariance[:, 2:, 2:] = walking.speed_std_mps**2 * np.eye(2)
    extent_m, extent_m2 = first_extent(detections.extent_m, body)
    begun = MapTracks(
        number=np.full(count, UNCONFIRMED, np.int64),
        mean=np.hstack([detections.position_m, np.zeros((count, 2))]),
        covariance=covariance,
        begun_m=detections.position_m,
        begun_us=stamp,
        seen_us=stamp,
        detections=np.ones(count, np.int64),
        looks=np.full(count, 1 << look, np.int64),
        evidence=first_evidence(detections, existence),
        looked_us=np.tile(stamp[:, None], sensors),
        misses=np.zeros(count, np.int64),
        frames=np.full(count, walking.first_frames),
        seen_by=detections.seen_by,
        hint=np.full((count, sensors), -1, np.int64),
        hinted_us=np.tile(stamp[:, None], sensors),
        extent_m=extent_m,
        extent_m2=extent_m2,
        heading_rad=np.full(count, np.nan),
    )
    return begun.hinted(detections.hint, detections.stamp_us)


def confirm(tracks: MapTracks, stamp_us: int, next_number: int, existence: Existence) -> MapTracks:
    """Numbers for the tracks that are believed from this stamp on, in the order of their beginning."""
    is_believed = (probability(tracks, existence) >= existence.believed) & (tracks.detections > 1)
    rows = np.flatnonzero(~tracks.is_confirmed & is_believed & (tracks.seen_us == stamp_us))
    if not len(rows):
        return tracks
    number = tracks.number.copy()
    number[rows] = np.arange(next_number, next_number + len(rows))
    return replace(tracks, number=number)


def _apart(detections: Detections, near_m: NDArray[np.float64], apart_m: float) -> Indices:
    """Those that are not too near to a track, nor to a new detection that is more credible."""
    to_track_m = _distance_m(detections.position_m, near_m)
    among_m = _distance_m(detections.position_m, detections.position_m)
    rank = np.argsort(np.argsort(-detections.score, kind="stable"), kind="stable")
    is_worse = rank[:, None] > rank[None, :]
    is_part = (to_track_m < apart_m).any(axis=1) | (is_worse & (among_m < apart_m)).any(axis=1)
    return np.flatnonzero(~is_part)


def _distance_m(left_m: NDArray[np.float64], right_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, m)"""
    offset_m = left_m[:, None, :] - right_m[None, :, :]
    return np.asarray(np.hypot(offset_m[..., 0], offset_m[..., 1]), np.float64)
