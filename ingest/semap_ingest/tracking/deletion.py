"""When a track is over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.tracking.existence import Existence, probability
from semap_ingest.tracking.map_tracks import MapTracks


@dataclass(frozen=True)
class Patience:
    """How long a track goes on unseen, in event time.

    confirmed_us    after which only the hint of a sensor, such as its image track, can bring it back
    by_hint_us      after which nothing can
    unconfirmed_us  after which an unconfirmed one is over, if two looks in a row were without it
    resting_us      after which one is over who stood when it went out of sight
    resting_mps     so fast is standing
    resting_misses  so many looks that could have seen it make no difference: sight is known roughly
    """

    confirmed_us: int = 1_500_000
    by_hint_us: int = 3_000_000
    unconfirmed_us: int = 300_000
    resting_us: int = 15_000_000
    resting_mps: float = 0.25
    resting_misses: int = 2


def rests(tracks: MapTracks, stamp_us: int, patience: Patience) -> NDArray[np.bool_]:
    """(n,), whether it stood when last seen, and hardly any look has missed it since: it still does."""
    is_recent = stamp_us - tracks.seen_us <= patience.resting_us
    speed_mps = np.hypot(tracks.mean[:, 2], tracks.mean[:, 3])
    stood = tracks.is_confirmed & (speed_mps <= patience.resting_mps)
    return np.asarray(stood & is_recent & (tracks.misses <= patience.resting_misses), np.bool_)


def is_over(tracks: MapTracks, stamp_us: int, patience: Patience, existence: Existence) -> NDArray[np.bool_]:
    """(n,), after the detections of that stamp.

    One that is refuted is over as well: it never was a person, or has slid from one to what stands beside.
    """
    unseen_us = stamp_us - tracks.seen_us
    since_hint_us = stamp_us - tracks.hinted_us.max(axis=1)
    can_return = (tracks.hint >= 0).any(axis=1) & (since_hint_us <= patience.by_hint_us)
    is_lost = (unseen_us > patience.confirmed_us) & ~(can_return & (unseen_us <= patience.by_hint_us))
    is_lost &= ~rests(tracks, stamp_us, patience)
    is_gone = (unseen_us > patience.unconfirmed_us) & (tracks.misses >= 2)
    is_refuted = probability(tracks, existence) <= existence.refuted
    return np.asarray(is_refuted | np.where(tracks.is_confirmed, is_lost, is_gone | is_lost), np.bool_)
