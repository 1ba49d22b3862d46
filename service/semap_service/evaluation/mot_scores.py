"""How well tracks follow persons: CLEAR MOT, IDF1 and HOTA, by TrackEval on positions, or on boxes.

TrackEval is for development only, and imported when it is needed. A person and a track at one stamp are
alike by 1 - distance / `zero_m`, not below 0, as in MOT15 3D; boxes of an image by their Jaccard index, as
in the MOTChallenge. CLEAR MOT (Bernardin and Stiefelhagen 2008)
and IDF1 (Ristani et al. 2016) count a pair from 0.5 on, HOTA (Luiten et al. 2021) is the mean over
thresholds from 0.05 to 0.95.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.tracking.overlap import jaccard_index

from semap.errors import InvalidInput

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Alike = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True, eq=False)
class Places:
    """Who was where, in any order.

    stamp_us    (n,)
    identity    (n,) numbers of persons, or of tracks; each once at a stamp
    position_m  (n, 2); for `box_scores` (n, 4) corners x_min, y_min, x_max, y_max [px]
    """

    stamp_us: Integers
    identity: Integers
    position_m: Floats

    def __len__(self) -> int:
        return len(self.stamp_us)


@dataclass(frozen=True)
class MotScores:
    """mota      1 - (missed + false_positives + switches) / places of persons
    idf1      F1 of places under the best assignment of tracks to persons over all time
    hota      geometric mean of detection_accuracy and association_accuracy, over all thresholds
    distance_m  mean of the pairs that CLEAR MOT counts; of boxes 1 - Jaccard index; NaN where there is none
    """

    mota: float
    idf1: float
    hota: float
    detection_accuracy: float
    association_accuracy: float
    distance_m: float
    missed: int
    false_positives: int
    switches: int
    fragments: int
    persons: int
    tracks: int


def places_of(states: Iterable[TrackStates]) -> Places:
    """The positions of all tracks at all stamps."""
    told = [each for each in states if len(each)]
    if not told:
        return Places(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))
    return Places(
        np.concatenate([np.full(len(each), each.stamp_us, np.int64) for each in told]),
        np.concatenate([each.track for each in told]),
        np.concatenate([each.position_m for each in told]),
    )


def mot_scores(truth: Places, tracks: Places, zero_m: float = 1.0) -> MotScores:
    """What TrackEval says of the tracks.

    truth   the persons, at the stamps at which they should be known; there is at least one
    tracks  at the same stamps; at another stamp a track is a false positive
    zero_m  from which distance on a person and a track are not alike at all
    raises  InvalidInput without TrackEval, without truth, and where an identity is twice at a stamp
    """
    return _scores(
        truth, tracks, lambda ours, theirs: np.maximum(0.0, 1 - cdist(ours, theirs) / zero_m), zero_m
    )


def box_scores(truth: Places, tracks: Places) -> MotScores:
    """The same of boxes in the images of one camera."""
    return _scores(truth, tracks, jaccard_index, 1.0)


def _scores(truth: Places, tracks: Places, alike: Alike, zero_m: float) -> MotScores:
    metrics = _track_eval_metrics()
    data = _sequence(truth, tracks, alike)
    clear, identity, hota = (metric.eval_sequence(data) for metric in metrics)
    paired = int(clear["CLR_TP"])
    return MotScores(
        mota=float(clear["MOTA"]),
        idf1=float(identity["IDF1"]),
        hota=float(np.mean(hota["HOTA"])),
        detection_accuracy=float(np.mean(hota["DetA"])),
        association_accuracy=float(np.mean(hota["AssA"])),
        distance_m=zero_m * (1 - float(clear["MOTP_sum"]) / paired) if paired else float("nan"),
        missed=int(clear["CLR_FN"]),
        false_positives=int(clear["CLR_FP"]),
        switches=int(clear["IDSW"]),
        fragments=int(clear["Frag"]),
        persons=data["num_gt_ids"],
        tracks=data["num_tracker_ids"],
    )


def _track_eval_metrics() -> tuple[Any, Any, Any]:
    try:
        from trackeval.metrics import CLEAR, HOTA, Identity  # noqa: PLC0415
    except ImportError as cause:
        raise InvalidInput(
            "TrackEval is not installed", "pip install --no-deps trackeval pycocotools tabulate"
        ) from cause
    quiet = {"THRESHOLD": 0.5, "PRINT_CONFIG": False}
    return CLEAR(quiet), Identity(quiet), HOTA()


def _sequence(truth: Places, tracks: Places, alike: Alike) -> dict[str, Any]:
    """What TrackEval's metrics read: identities as indices from 0, per stamp, and how alike they are."""
    if not len(truth):
        raise InvalidInput(
            "there is nobody to compare tracks with", "Give the places of at least one person."
        )
    stamps = np.union1d(truth.stamp_us, tracks.stamp_us)
    persons, person = np.unique(truth.identity, return_inverse=True)
    numbers, number = np.unique(tracks.identity, return_inverse=True)
    at_truth, at_tracks = _by_stamp(truth, stamps), _by_stamp(tracks, stamps)
    return {
        "num_timesteps": len(stamps),
        "num_gt_ids": len(persons),
        "num_tracker_ids": len(numbers),
        "num_gt_dets": len(truth),
        "num_tracker_dets": len(tracks),
        "gt_ids": [person[rows] for rows in at_truth],
        "tracker_ids": [number[rows] for rows in at_tracks],
        "similarity_scores": [
            alike(truth.position_m[ours], tracks.position_m[theirs])
            for ours, theirs in zip(at_truth, at_tracks, strict=True)
        ],
    }


def _by_stamp(places: Places, stamps: Integers) -> list[Integers]:
    """Rows at each stamp."""
    order = np.lexsort([places.identity, places.stamp_us])
    same = (np.diff(places.stamp_us[order]) == 0) & (np.diff(places.identity[order]) == 0)
    if same.any():
        row = order[int(np.argmax(same))]
        raise InvalidInput(
            f"{places.identity[row]} is in two places at {places.stamp_us[row]} us",
            "Give each identity one place at a stamp.",
        )
    first = np.searchsorted(places.stamp_us[order], stamps)
    return np.split(order, first[1:])
