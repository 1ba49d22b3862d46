"""Persons on the map: associate, update, delete, initiate.

Tracks move with constant velocity in a fixed frame (`kalman`, `walking`). A step is the same for any time
since the last one. All roles are pure functions of the tracks; only `amendment` remembers more.

Promised: numbers count from 1 in the order of confirmation and are never used again; the order of
detections within a frame does not matter; only tracks that were detected at a stamp are told at it, never
guesses; each track that was told is told to have ended once, at the latest by `finish`. Not promised:
that a number is one person for ever. What turns out later is an amendment.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.sensing.detections import Detections
from semap_ingest.sensing.track_states import TrackAmendment, TrackStates
from semap_ingest.tracking.amendment import Amender, Evidence
from semap_ingest.tracking.assignment import unassigned
from semap_ingest.tracking.association import Association, Pairs, associate
from semap_ingest.tracking.deletion import Patience, is_over
from semap_ingest.tracking.detection_rows import check, chosen, in_order
from semap_ingest.tracking.footprint import Body, heading, next_extent
from semap_ingest.tracking.initiation import Initiation, begin, confirm, points_of
from semap_ingest.tracking.kalman import less_certain, predict, update
from semap_ingest.tracking.map_tracks import UNCONFIRMED, MapTracks, no_tracks
from semap_ingest.tracking.walking import Walking, sway_covariance

Floats = NDArray[np.float64]
SCORE_MEMORY = 15
"""Over so many detections a track's score is a mean."""


@dataclass(frozen=True)
class MapTrackerSettings:
    walking: Walking = field(default_factory=Walking)
    association: Association = field(default_factory=Association)
    initiation: Initiation = field(default_factory=Initiation)
    patience: Patience = field(default_factory=Patience)
    body: Body = field(default_factory=Body)
    evidence: Evidence = field(default_factory=Evidence)


class MapTracker:
    """The tracks of one map.

    late  how many frames were ignored because they were not newer than one before
    """

    def __init__(self, settings: MapTrackerSettings | None = None) -> None:
        self.late = 0
        self._settings = settings or MapTrackerSettings()
        self._frame = ""
        self._stamp_us: int | None = None
        self._next_number = 1
        self._tracks = no_tracks(self._settings.initiation.frames)
        self._amender = Amender(self._settings.evidence)

    def step(self, detections: Detections) -> TrackStates:
        """The confirmed tracks that are among these detections; none if these are not newer than the last.

        raises  InvalidInput for numbers that are not finite, covariances that are none, and another frame of
                reference
        """
        self._check(detections)
        stamp_us = detections.stamp_us
        if self._stamp_us is not None and stamp_us <= self._stamp_us:
            self.late += 1
            return _states(self._tracks, np.zeros(len(self._tracks), np.bool_), stamp_us, detections.frame)
        settings = self._settings
        detections = in_order(detections)
        tracks = self._predicted(stamp_us)
        sway_m2 = sway_covariance(tracks, stamp_us, settings.walking)
        covariance_m2 = sway_m2[:, None] + detections.covariance_m2[None, :]
        pairs = associate(tracks, detections, covariance_m2, settings.association, settings.patience)
        rivals = _numbers_of_rivals(tracks, pairs)
        slip_m = settings.association.slip_m
        tracks = _updated(tracks, detections, pairs, covariance_m2, settings.body, slip_m)
        fresh = unassigned(len(detections), pairs.detection)
        if len(fresh):
            near = tracks.mean[pairs.track, :2]
            begun = begin(
                chosen(detections, fresh), near, settings.initiation, settings.walking, settings.body
            )
            tracks = tracks.joined(begun)
        tracks = confirm(tracks, stamp_us, self._next_number, settings.initiation)
        self._next_number = max(self._next_number, int(tracks.number.max(initial=0)) + 1)
        self._stamp_us, self._frame = stamp_us, detections.frame
        return self._ended_and_amended(tracks, rivals)

    def finish(self) -> TrackStates:
        """At the end of a recording: no more states, and all tracks that are left as ended."""
        ended = _ended(self._tracks.chosen(self._tracks.is_confirmed))
        self._tracks = no_tracks(self._settings.initiation.frames)
        return _states(self._tracks, np.zeros(0, np.bool_), self._stamp_us or 0, self._frame, ended)

    def _check(self, detections: Detections) -> None:
        check(detections)
        if self._stamp_us is not None and detections.frame != self._frame:
            raise InvalidInput(
                f"detections in {detections.frame} came to the tracker of {self._frame}",
                "Transform all detections into one fixed frame, or use one map tracker for each.",
            )

    def _predicted(self, stamp_us: int) -> MapTracks:
        """The tracks at a stamp, before its detections: as yet it has brought no points."""
        if self._stamp_us is None or not len(self._tracks):
            return self._tracks
        step_s = (stamp_us - self._stamp_us) / 1e6
        motion = predict(self._tracks.motion, step_s, self._settings.walking.acceleration_density)
        points = np.zeros_like(self._tracks.points)
        points[:, 1:] = self._tracks.points[:, :-1]
        return replace(self._tracks, mean=motion.mean, covariance=motion.covariance, points=points)

    def _ended_and_amended(self, tracks: MapTracks, rivals: list[tuple[int, int]]) -> TrackStates:
        """Keeps the tracks that go on; says where they are, which are over, and what turns out."""
        stamp_us = self._stamp_us or 0
        merged = self._amender.merged_alive(tracks, stamp_us)
        is_gone = is_over(tracks, stamp_us, self._settings.patience)
        for amendment in merged:
            is_gone |= tracks.number == amendment.track
        gone = tracks.chosen(is_gone & tracks.is_confirmed)
        self._tracks = tracks.chosen(~is_gone) if is_gone.any() else tracks
        found = self._amender.find(self._tracks, rivals, gone, stamp_us)
        seen = self._tracks.is_confirmed & (self._tracks.seen_us == stamp_us)
        return _states(self._tracks, seen, stamp_us, self._frame, _ended(gone), (*merged, *found))


def _updated(
    tracks: MapTracks,
    detections: Detections,
    pairs: Pairs,
    covariance_m2: Floats,
    body: Body,
    slip_m: float,
) -> MapTracks:
    """The tracks after what they were detected as.

    covariance_m2  (n, m, 2, 2) of each detection as a measurement of each track
    """
    rows, columns = pairs.track, pairs.detection
    if not len(rows):
        return tracks
    seen = tracks if len(rows) == len(tracks) else tracks.chosen(rows)
    stamp_us = detections.stamp_us
    before = less_certain(seen.motion, pairs.has_slipped, slip_m)
    motion = update(before, detections.position_m[columns], covariance_m2[rows, columns])
    step_s = (stamp_us - seen.seen_us)[:, None] / 1e6
    extent_m, extent_m2 = next_extent(
        seen.extent_m, seen.extent_m2, detections.extent_m[columns], step_s, body
    )
    count = seen.detections + 1
    image_track = detections.image_track[columns]
    points = seen.points.copy()
    points[:, 0] = points_of(detections.seen_by[columns])
    now = replace(
        seen,
        mean=motion.mean,
        covariance=motion.covariance,
        seen_us=np.full(len(rows), stamp_us),
        detections=count,
        points=points,
        score=seen.score + (detections.score[columns] - seen.score) / np.minimum(count, SCORE_MEMORY),
        seen_by=seen.seen_by | detections.seen_by[columns],
        image_track=np.where(image_track >= 0, image_track, seen.image_track),
        image_seen_us=np.where(image_track >= 0, stamp_us, seen.image_seen_us),
        extent_m=extent_m,
        extent_m2=extent_m2,
        heading_rad=heading(seen.heading_rad, motion.mean, motion.covariance, body),
    )
    return tracks.replaced(rows, now)


def _numbers_of_rivals(tracks: MapTracks, pairs: Pairs) -> list[tuple[int, int]]:
    """Pairs of confirmed tracks."""
    numbers = tracks.number[pairs.rivals]
    numbers = numbers[(numbers != UNCONFIRMED).all(axis=1)]
    return [(first, second) for first, second in numbers.tolist()]


def _ended(tracks: MapTracks) -> tuple[tuple[int, int], ...]:
    order = np.argsort(tracks.number)
    return tuple(zip(tracks.number[order].tolist(), tracks.seen_us[order].tolist(), strict=True))


def _states(
    tracks: MapTracks,
    which: NDArray[np.bool_],
    stamp_us: int,
    frame: str,
    ended: tuple[tuple[int, int], ...] = (),
    amendments: tuple[TrackAmendment, ...] = (),
) -> TrackStates:
    """By number."""
    rows = np.flatnonzero(which)
    rows = rows[np.argsort(tracks.number[rows])]
    mean = tracks.mean[rows]
    return TrackStates(
        stamp_us=stamp_us,
        frame=frame,
        track=tracks.number[rows],
        position_m=mean[:, :2],
        velocity_mps=mean[:, 2:],
        covariance_m2=tracks.covariance[rows, :2, :2],
        extent_m=tracks.extent_m[rows],
        heading_rad=tracks.heading_rad[rows],
        ended=ended,
        amendments=amendments,
    )
