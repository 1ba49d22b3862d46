"""Whether there is a person behind a track: log odds that grow and fall with what is seen, over time.

A sequential test (Wald 1945). Each look that could see a track adds the log of how much likelier what it
saw is with a person than without: the credibility of a detection, or that one was missed. Looks that follow
one another closely show the same view again and are no new evidence, so each counts as a part of a view, by
the time since the last one of its sensor. So it takes seconds and not frames, whatever the rate. Old views
are forgotten: nothing is better known than `memory` views tell, or a table leg that looks a little like a leg
would be one in the end. A track begins with the odds of what its kind of sensor makes up. Once it is
believed, not to be seen is no evidence: walls and people hide.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.detections import CAMERA, LASER, Detections
from semap_ingest.tracking.map_tracks import MapTracks

Floats = NDArray[np.float64]
LEAST_SCORE = 0.01


@dataclass(frozen=True)
class Existence:
    """When a track is believed, and what speaks for it.

    begun_by_laser, begun_by_camera  probability of a track that only lasers have seen, and of others
    believed, refuted      probabilities where the test ends
    view_s                 how long looks of one sensor show the same view of who walks
    standing_view_s        the same of who stands: it looks the same for longer
    memory                 so many views are remembered
    neutral_camera         score of a camera's detection that speaks neither for nor against a person
    neutral_laser          the same of a laser's
    walks                  log odds of a laser's detection of what walks: things stand still
    walked_m, walking_mps  it walks when it is so far from where it began, and so fast
    missed                 log odds of a look that did not see it, at least
    """

    begun_by_laser: float = 0.12
    begun_by_camera: float = 0.38
    believed: float = 0.88
    refuted: float = 0.02
    view_s: float = 0.3
    standing_view_s: float = 0.4
    memory: float = 6.0
    neutral_camera: float = 0.2
    neutral_laser: float = 0.7
    walks: float = 2.0
    walked_m: float = 0.4
    walking_mps: float = 0.3
    missed: float = -1.5


def probability(tracks: MapTracks, settings: Existence) -> Floats:
    """(n,) of there being a person."""
    is_laser_only = tracks.seen_by == LASER
    begun = np.where(is_laser_only, settings.begun_by_laser, settings.begun_by_camera)
    return np.asarray(1 / (1 + np.exp(-(tracks.evidence + _log_odds(begun)))), np.float64)


def first_evidence(look: Detections, settings: Existence) -> Floats:
    """(n,) of tracks that begin with these detections."""
    return _of_detections(look, settings)


def looked_at(
    tracks: MapTracks,
    look: Detections,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    settings: Existence,
) -> MapTracks:
    """The tracks with what a look says of them.

    rows, columns  tracks and the detections that are theirs
    """
    counts = look.sight.reaches(tracks.mean[:, :2]) & look.tells_all
    counts[rows] = True
    told = np.where(tracks.is_confirmed, 0.0, max(settings.missed, float(np.log1p(-look.detected))))
    told[rows] = _of_detections(look, settings)[columns]
    walks = _walks(tracks, settings)
    is_lasers = np.zeros(len(tracks), np.bool_)
    is_lasers[rows] = look.seen_by[columns] == LASER
    told += settings.walks * (walks & is_lasers)
    since_s = (look.stamp_us - tracks.looked_us[:, look.sensor]) / 1e6
    share = np.minimum(since_s / np.where(walks, settings.view_s, settings.standing_view_s), 1.0)
    gained = share * (told - tracks.evidence / settings.memory)
    looked_us = tracks.looked_us.copy()
    looked_us[counts, look.sensor] = look.stamp_us
    misses = tracks.misses + counts
    misses[rows] = 0
    return replace(
        tracks,
        evidence=tracks.evidence + np.where(counts, gained, 0.0),
        looked_us=looked_us,
        misses=misses,
    )


def _of_detections(look: Detections, settings: Existence) -> Floats:
    score = np.clip(look.score, LEAST_SCORE, 1 - LEAST_SCORE)
    neutral = np.where(look.seen_by & CAMERA, settings.neutral_camera, settings.neutral_laser)
    return _log_odds(score) - _log_odds(neutral)


def _log_odds(probability: Floats) -> Floats:
    return np.asarray(np.log(probability / (1 - probability)), np.float64)


def _walks(tracks: MapTracks, settings: Existence) -> NDArray[np.bool_]:
    way_m = tracks.mean[:, :2] - tracks.begun_m
    speed_mps = np.hypot(tracks.mean[:, 2], tracks.mean[:, 3])
    has_walked = np.hypot(way_m[:, 0], way_m[:, 1]) >= settings.walked_m
    return np.asarray(has_walked & (speed_mps >= settings.walking_mps), np.bool_)
