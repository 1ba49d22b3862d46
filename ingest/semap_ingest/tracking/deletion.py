"""When a track is over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.tracking.map_tracks import MapTracks


@dataclass(frozen=True)
class Patience:
    """How long a track goes on unseen, in event time.

    confirmed_us    after which only its image track can bring it back
    by_image_us     after which nothing can
    unconfirmed_us  after which an unconfirmed one is over, if two frames in a row were without it
    least_score     a track whose detections' scores come down to this on the mean is over: it has slid from
                    the person to something that stands beside
    least_standing_score  the same for one that is slower than `standing_mps`, and that the camera has not
                          seen for `without_image_us`
    """

    confirmed_us: int = 1_500_000
    by_image_us: int = 3_000_000
    unconfirmed_us: int = 300_000
    least_score: float = 0.25
    least_standing_score: float = 0.5
    standing_mps: float = 0.3
    without_image_us: int = 1_000_000


def is_over(tracks: MapTracks, stamp_us: int, patience: Patience) -> NDArray[np.bool_]:
    """(n,), after the detections of that stamp."""
    unseen_us = stamp_us - tracks.seen_us
    since_image_us = np.where(
        tracks.image_track >= 0, stamp_us - tracks.image_seen_us, stamp_us - tracks.begun_us
    )
    can_return = (tracks.image_track >= 0) & (since_image_us <= patience.by_image_us)
    is_lost = (unseen_us > patience.confirmed_us) & ~(can_return & (unseen_us <= patience.by_image_us))
    is_gone = (unseen_us > patience.unconfirmed_us) & (tracks.points[:, :2] == 0).all(axis=1)
    stands = np.hypot(tracks.mean[:, 2], tracks.mean[:, 3]) < patience.standing_mps
    is_laser_only = since_image_us > patience.without_image_us
    least_score = np.where(
        stands & is_laser_only & tracks.is_confirmed, patience.least_standing_score, patience.least_score
    )
    has_slid = tracks.score <= least_score
    return has_slid | np.where(tracks.is_confirmed, is_lost, is_gone | is_lost)
