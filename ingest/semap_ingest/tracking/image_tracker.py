"""Boxes of an image detector, told apart and numbered from image to image.

A track is a box whose centre, width and height move with constant velocity (the state of BoT-SORT, Aharon
et al. 2022; SORT's of Bewley et al. 2016 has area and aspect instead, which fit worse where a person is
half hidden), all noise in proportion to its height as in DeepSORT (Wojke et al. 2017), in continuous
time, so that images may come at any rate. Boxes go to tracks by the Jaccard index in two rounds
(ByteTrack, Zhang et al. 2022): first those of high score, then those of low score to tracks that were
seen lately, as a person who is nearly hidden scores low. The longer a track was not seen, the further
both boxes are widened before they are compared (C-BIoU, Yang et al. 2023). A low score alone begins no
track.

A track is told once its boxes are evidence enough: their scores as log odds, summed as a sequential test does
(Wald 1945). Images that follow closely show the same view and count in part, so that it takes seconds and not
images. Old views are forgotten, and who has weak boxes alone for seconds is believed no more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit

from semap.errors import InvalidInput
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.tracking.assignment import Indices, assign, unassigned
from semap_ingest.tracking.kalman import Gaussians, predict, update
from semap_ingest.tracking.overlap import centre_and_size, corners, jaccard_index, widened

Floats = NDArray[np.float64]
UNBELIEVED = -1
LEAST_SCORE = 0.05


@dataclass(frozen=True)
class ImageTrackerSettings:
    """How boxes move and are compared; lengths in heights of the box.

    high_score            from which a box is assigned in the first round
    new_score             from which a box that no track explains begins one
    believed              log odds from which a track is told
    neutral_score         of a box that speaks neither for nor against a person
    view_s                how long images show the same view: nearer ones are evidence in part
    memory                so many views are remembered
    missed                log odds of an image without a box of a track that is not believed yet
    min_overlap           Jaccard index that a pair needs, in the first round and in the second
    widening_per_s        share of its size by which a box grows on each side for each second unseen
    max_widening
    seen_lately_s         how long a track takes part in the second round
    kept_s                how long a track is kept after it was last seen
    measurement_std       of a box's centre and size [heights]
    acceleration_density  [heights^2/s^3]
    speed_std             of a new track, per axis [heights/s]
    """

    high_score: float = 0.5
    new_score: float = 0.5
    believed: float = 4.9
    neutral_score: float = 0.3
    view_s: float = 0.1
    memory: float = 20.0
    missed: float = -4.0
    min_overlap: tuple[float, float] = (0.25, 0.5)
    widening_per_s: float = 0.5
    max_widening: float = 0.4
    seen_lately_s: float = 0.6
    kept_s: float = 1.5
    measurement_std: float = 0.1
    acceleration_density: float = 0.5
    speed_std: float = 1.0


@dataclass(frozen=True, eq=False)
class _Seen:
    """Boxes of one image that have an area, in an order that does not depend on the detector's.

    index       (n,) where each is in the detector's order
    corners_px  (n, 4)
    """

    index: Indices
    corners_px: Floats
    score: Floats
    label: NDArray[np.str_]


@dataclass(frozen=True, eq=False)
class _ImageTracks:
    """number, label, seen_us  (n,); box  (n, 8) centre, width, height [px] and their velocities [px/s]

    number    UNBELIEVED until there is evidence enough
    evidence  (n,) log odds of there being something
    """

    number: NDArray[np.int64]
    label: NDArray[np.str_]
    seen_us: NDArray[np.int64]
    evidence: Floats
    box: Gaussians

    def __len__(self) -> int:
        return len(self.number)

    def kept(self, which: NDArray[np.bool_]) -> _ImageTracks:
        box = Gaussians(self.box.mean[which], self.box.covariance[which])
        return _ImageTracks(
            self.number[which], self.label[which], self.seen_us[which], self.evidence[which], box
        )

    def joined(self, other: _ImageTracks) -> _ImageTracks:
        return _ImageTracks(
            np.concatenate([self.number, other.number]),
            np.concatenate([self.label, other.label]),
            np.concatenate([self.seen_us, other.seen_us]),
            np.concatenate([self.evidence, other.evidence]),
            Gaussians(
                np.concatenate([self.box.mean, other.box.mean]),
                np.concatenate([self.box.covariance, other.box.covariance]),
            ),
        )


class ImageTracker:
    """The tracks of one camera's images, numbered from 1.

    late  how many images were ignored because they were not newer than one before
    """

    def __init__(self, settings: ImageTrackerSettings | None = None) -> None:
        self.late = 0
        self._settings = settings or ImageTrackerSettings()
        self._frame = ""
        self._stamp_us: int | None = None
        self._next_number = 1
        self._tracks = _ImageTracks(
            np.zeros(0, np.int64),
            np.zeros(0, np.str_),
            np.zeros(0, np.int64),
            np.zeros(0),
            Gaussians(np.zeros((0, 8)), np.zeros((0, 8, 8))),
        )

    def step(self, boxes: Boxes) -> Boxes:
        """The same boxes with their tracks; -1 for a box of low score that no track explains, for one without
        an area, and for all in an image that is not newer than the one before.

        raises  InvalidInput for corners or scores that are not numbers, and for boxes of another camera
        """
        self._check(boxes)
        number = np.full(len(boxes), -1, np.int64)
        if self._stamp_us is not None and boxes.stamp_us <= self._stamp_us:
            self.late += 1
            return replace(boxes, track=number)
        seen = _seen(boxes)
        tracks = self._predicted(boxes.stamp_us)
        rows, columns = self._assigned(tracks, seen, boxes.stamp_us)
        fresh = unassigned(len(seen.index), columns)
        fresh = fresh[seen.score[fresh] >= self._settings.new_score]
        tracks = self._updated(tracks, rows, seen, columns, boxes.stamp_us)
        count = len(tracks)
        tracks = self._told(tracks.joined(self._begun(seen, fresh, boxes.stamp_us)))
        number[seen.index[columns]] = tracks.number[rows]
        number[seen.index[fresh]] = tracks.number[count:]
        self._tracks = tracks.kept(tracks.evidence > 0)
        self._stamp_us, self._frame = boxes.stamp_us, boxes.frame
        return replace(boxes, track=number)

    def _check(self, boxes: Boxes) -> None:
        if not (np.isfinite(boxes.corners_px).all() and np.isfinite(boxes.score).all()):
            raise InvalidInput(
                "corners or scores of boxes are not finite numbers",
                "Have the image detector leave such boxes out.",
                f"boxes of {boxes.frame} at {boxes.stamp_us} us",
            )
        if self._stamp_us is not None and boxes.frame != self._frame:
            raise InvalidInput(
                f"boxes of the camera {boxes.frame} came to the tracker of {self._frame}",
                "Use one image tracker for each camera.",
            )

    def _predicted(self, stamp_us: int) -> _ImageTracks:
        """The tracks that are kept until a stamp; those not in the last image keep the size that they had."""
        if self._stamp_us is None:
            return self._tracks
        settings = self._settings
        tracks = self._tracks.kept(stamp_us - self._tracks.seen_us <= settings.kept_s * 1e6)
        mean = tracks.box.mean.copy()
        mean[tracks.seen_us < self._stamp_us, 6:] = 0.0
        density = settings.acceleration_density * np.maximum(mean[:, 3], 1.0) ** 2
        step_s = (stamp_us - self._stamp_us) / 1e6
        return replace(tracks, box=predict(Gaussians(mean, tracks.box.covariance), step_s, density))

    def _assigned(self, tracks: _ImageTracks, seen: _Seen, stamp_us: int) -> tuple[Indices, Indices]:
        """Rows of tracks and of boxes that belong together."""
        settings = self._settings
        unseen_s = (stamp_us - tracks.seen_us) / 1e6
        share = np.minimum(settings.widening_per_s * unseen_s, settings.max_widening)
        expected_px = widened(corners(tracks.box.mean[:, :4]), share)
        overlap = np.empty((len(tracks), len(seen.index)))
        for each in np.unique(share):
            rows = share == each
            overlap[rows] = jaccard_index(expected_px[rows], widened(seen.corners_px, each))
        cost = np.where(tracks.label[:, None] == seen.label[None, :], 1.0 - overlap, np.inf)
        is_high = seen.score >= settings.high_score
        first_min, second_min = settings.min_overlap
        rows, columns = assign(np.where(is_high, cost, np.inf), 1.0 - first_min)
        is_left = unseen_s <= settings.seen_lately_s
        is_left[rows] = False
        more = assign(np.where(is_left[:, None] & ~is_high, cost, np.inf), 1.0 - second_min)
        return np.concatenate([rows, more[0]]), np.concatenate([columns, more[1]])

    def _updated(
        self, tracks: _ImageTracks, rows: Indices, seen: _Seen, columns: Indices, stamp_us: int
    ) -> _ImageTracks:
        box = Gaussians(tracks.box.mean[rows], tracks.box.covariance[rows])
        measured = centre_and_size(seen.corners_px[columns])
        box = update(box, measured, self._measurement_covariance(measured))
        mean, covariance, seen_us = (
            tracks.box.mean.copy(),
            tracks.box.covariance.copy(),
            tracks.seen_us.copy(),
        )
        mean[rows], covariance[rows], seen_us[rows] = box.mean, box.covariance, stamp_us
        told = np.where(tracks.number == UNBELIEVED, self._settings.missed, 0.0)
        told[rows] = self._evidence(seen.score[columns])
        told -= tracks.evidence / self._settings.memory
        since_us = 0 if self._stamp_us is None else stamp_us - self._stamp_us
        evidence = tracks.evidence + min(since_us / 1e6 / self._settings.view_s, 1.0) * told
        return replace(tracks, seen_us=seen_us, evidence=evidence, box=Gaussians(mean, covariance))

    def _evidence(self, score: Floats) -> Floats:
        """Log odds (n,) that boxes of these scores speak for a person."""
        odds = logit(np.clip(score, LEAST_SCORE, 1 - LEAST_SCORE))
        return np.asarray(odds - logit(self._settings.neutral_score), np.float64)

    def _told(self, tracks: _ImageTracks) -> _ImageTracks:
        """Numbers for those that are believed now, in the order of their beginning."""
        rows = np.flatnonzero((tracks.number == UNBELIEVED) & (tracks.evidence >= self._settings.believed))
        number = tracks.number.copy()
        number[rows] = np.arange(self._next_number, self._next_number + len(rows))
        self._next_number += len(rows)
        return replace(tracks, number=number)

    def _begun(self, seen: _Seen, fresh: Indices, stamp_us: int) -> _ImageTracks:
        number = np.full(len(fresh), UNBELIEVED, np.int64)
        measured = centre_and_size(seen.corners_px[fresh])
        covariance = np.zeros((len(fresh), 8, 8))
        covariance[:, :4, :4] = self._measurement_covariance(measured)
        speed_variance = (self._settings.speed_std * measured[:, 3]) ** 2
        covariance[:, 4:, 4:] = speed_variance[:, None, None] * np.eye(4)
        box = Gaussians(np.hstack([measured, np.zeros_like(measured)]), covariance)
        evidence = self._evidence(seen.score[fresh])
        return _ImageTracks(number, seen.label[fresh], np.full(len(fresh), stamp_us), evidence, box)

    def _measurement_covariance(self, centre_and_size_px: Floats) -> Floats:
        variance = (self._settings.measurement_std * centre_and_size_px[:, 3]) ** 2
        return variance[:, None, None] * np.eye(4)


def _seen(boxes: Boxes) -> _Seen:
    label = np.asarray(boxes.label, np.str_)
    index = np.lexsort([label, boxes.score, *boxes.corners_px.T[::-1]])
    corners_px = boxes.corners_px[index]
    index = index[(corners_px[:, 2:] > corners_px[:, :2]).all(axis=1)]
    return _Seen(index, boxes.corners_px[index], boxes.score[index], label[index])
