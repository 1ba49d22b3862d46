"""How a track begins, and when it is believed.

A detection that no track explains begins one. It is confirmed when its last n frames gave m points (m of
n; one seen by both sensors at once gives two, so that a person in sight of both is known after two
frames), and its detections were credible on the mean. One that the laser alone has ever seen must be more
credible, and more still while it has not moved from its place: legs of tables stand still.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.detections import BOTH, LASER, Detections
from semap_ingest.tracking.assignment import Indices
from semap_ingest.tracking.detection_rows import chosen
from semap_ingest.tracking.footprint import Body, first_extent
from semap_ingest.tracking.map_tracks import UNCONFIRMED, MapTracks
from semap_ingest.tracking.walking import Walking


@dataclass(frozen=True)
class Initiation:
    """What it takes to be believed.

    points, frames        m and n
    least_score           on the mean, for one that the camera has seen
    laser_walking_score   for one that only the laser has seen, `walked_m` from where it began
    laser_standing_score  for one that only the laser has seen
    apart_m               nearer to a track that was seen in the same frame nobody else can stand
    """

    points: int = 4
    frames: int = 8
    least_score: float = 0.25
    laser_walking_score: float = 0.55
    laser_standing_score: float = 0.75
    walked_m: float = 0.4
    apart_m: float = 0.3


def points_of(seen_by: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(n,) towards confirmation"""
    return np.where(seen_by == BOTH, 2, 1).astype(np.uint8)


def begin(
    detections: Detections, near_m: NDArray[np.float64], settings: Initiation, walking: Walking, body: Body
) -> MapTracks:
    """New tracks of detections that are of none.

    near_m  (k, 2) the tracks that were detected at this stamp: what is too near to one is a part of it
    """
    detections = chosen(detections, _apart(detections, near_m, settings.apart_m))
    count = len(detections)
    stamp = np.full(count, detections.stamp_us, np.int64)
    covariance = np.zeros((count, 4, 4))
    covariance[:, :2, :2] = detections.covariance_m2 + walking.stance_std_m**2 * np.eye(2)
    covariance[:, 2:, 2:] = walking.speed_std_mps**2 * np.eye(2)
    points = np.zeros((count, settings.frames), np.uint8)
    points[:, 0] = points_of(detections.seen_by)
    extent_m, extent_m2 = first_extent(detections.extent_m, body)
    return MapTracks(
        number=np.full(count, UNCONFIRMED, np.int64),
        mean=np.hstack([detections.position_m, np.zeros((count, 2))]),
        covariance=covariance,
        begun_m=detections.position_m,
        begun_us=stamp,
        seen_us=stamp,
        detections=np.ones(count, np.int64),
        points=points,
        score=detections.score,
        seen_by=detections.seen_by,
        image_track=detections.image_track,
        image_seen_us=stamp,
        extent_m=extent_m,
        extent_m2=extent_m2,
        heading_rad=np.full(count, np.nan),
    )


def confirm(tracks: MapTracks, stamp_us: int, next_number: int, settings: Initiation) -> MapTracks:
    """Numbers for the tracks that are believed from this stamp on, in the order of their beginning."""
    is_laser_only = tracks.seen_by == LASER
    way_m = tracks.mean[:, :2] - tracks.begun_m
    has_walked = np.hypot(way_m[:, 0], way_m[:, 1]) >= settings.walked_m
    laser_score = np.where(has_walked, settings.laser_walking_score, settings.laser_standing_score)
    is_credible = tracks.score >= np.where(is_laser_only, laser_score, settings.least_score)
    enough = tracks.points.sum(axis=1) >= settings.points
    rows = np.flatnonzero(~tracks.is_confirmed & is_credible & enough & (tracks.seen_us == stamp_us))
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
