"""Persons on the map: predict, associate, update, initiate, confirm, delete.

Tracks move with constant velocity in a fixed frame (`kalman`, `walking`). A step is one moment: each sensor
that looked at it is one after the other associated with the tracks and corrects them. It is the same for any
time since the last one. All roles are pure functions of the tracks; only `amendment` remembers more.

Promised: numbers count from 1 in the order of confirmation and are never used again; the order of
detections within a look does not matter; only tracks that were detected at a stamp are told at it, never
guesses; each track that was told is told to have ended once, at the latest by `finish`. Not promised:
that a number is one person for ever. What turns out later is an amendment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.sensing.detections import Detections
from semap_ingest.sensing.track_states import TrackAmendment, TrackStates
from semap_ingest.tracking.amendment import Amender, Evidence
from semap_ingest.tracking.assignment import unassigned
from semap_ingest.tracking.association import RESTING_US, Association, Pairs, associate
from semap_ingest.tracking.deletion import Patience, is_over, rests
from semap_ingest.tracking.detection_rows import check, chosen, in_order
from semap_ingest.tracking.existence import Existence, looked_at
from semap_ingest.tracking.footprint import Body, heading, next_extent
from semap_ingest.tracking.initiation import Initiation, begin, confirm
from semap_ingest.tracking.kalman import Gaussians, less_certain, predict, update
from semap_ingest.tracking.map_tracks import UNCONFIRMED, MapTracks, no_tracks
from semap_ingest.tracking.walking import Walking, frames_within, sway_covariance

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MapTrackerSettings:
    walking: Walking = field(default_factory=Walking)
    association: Association = field(default_factory=Association)
    initiation: Initiation = field(default_factory=Initiation)
    existence: Existence = field(default_factory=Existence)
    patience: Patience = field(default_factory=Patience)
    body: Body = field(default_factory=Body)
    evidence: Evidence = field(default_factory=Evidence)


class MapTracker:
    """The tracks of one map.

    late     how many looks were ignored because they were not newer than one before
    sensors  how many there are that may give hints (`Detections.hint`)
    """

    def __init__(self, settings: MapTrackerSettings | None = None, sensors: int = 1) -> None:
        self.late = 0
        self._settings = settings or MapTrackerSettings()
        self._frame = ""
        self._stamp_us: int | None = None
        self._next_number = 1
        self._sensors = sensors
        self._tracks = no_tracks(sensors)
        self._amender = Amender(self._settings.evidence)

    @property
    def believed_m(self) -> Floats:
        """(k, 2) where the confirmed tracks were last thought to be [m]."""
        return self._tracks.mean[self._tracks.is_confirmed, :2]

    def step(self, *looks: Detections) -> TrackStates:
        """The confirmed tracks that were detected in a moment; none if it is not newer than the last.

        looks   of one stamp, at most 62 of them, in the order in which they correct the tracks
        raises  InvalidInput for numbers that are not finite, covariances that are none, other stamps, and
                another frame of reference
        """
        stamp_us, frame = self._check(looks)
        if self._stamp_us is not None and stamp_us <= self._stamp_us:
            self.late += len(looks)
            return _states(self._tracks, np.zeros(len(self._tracks), np.bool_), stamp_us, frame)
        tracks = self._predicted(stamp_us)
        rivals: list[tuple[int, int]] = []
        for number, look in enumerate(looks):
            tracks, mistakable = self._looked(tracks, in_order(look), number)
            rivals += mistakable
        tracks = confirm(tracks, stamp_us, self._next_number, self._settings.existence)
        self._next_number = max(self._next_number, int(tracks.number.max(initial=0)) + 1)
        self._stamp_us, self._frame = stamp_us, frame
        return self._ended_and_amended(tracks, rivals, is_watched=any(look.tells_all for look in looks))

    def _looked(
        self, tracks: MapTracks, look: Detections, number: int
    ) -> tuple[MapTracks, list[tuple[int, int]]]:
        """The tracks after one sensor's detections, and those that could have been mistaken."""
        settings = self._settings
        frames = frames_within(tracks, look.stamp_us, settings.walking)
        sway_m2 = sway_covariance(tracks, frames, settings.walking)
        covariance_m2 = sway_m2[:, None] + look.covariance_m2[None, :]
        pairs = associate(tracks, look, covariance_m2, settings.association, settings.patience)
        rivals = _numbers_of_rivals(tracks, pairs)
        tracks = replace(tracks, frames=_counted(tracks, frames, pairs))
        tracks = looked_at(tracks, look, pairs.track, pairs.detection, settings.existence)
        tracks = _updated(tracks, look, number, pairs, covariance_m2, settings)
        fresh = unassigned(len(look), pairs.detection)
        if len(fresh):
            near = tracks.mean[pairs.track, :2]
            begun = begin(
                chosen(look, fresh),
                near,
                number,
                self._sensors,
                settings.initiation,
                settings.existence,
                settings.walking,
                settings.body,
            )
            tracks = tracks.joined(begun)
        return tracks, rivals

    def finish(self) -> TrackStates:
        """At the end of a recording: no more states, and all tracks that are left as ended."""
        ended = _ended(self._tracks.chosen(self._tracks.is_confirmed))
        self._tracks = no_tracks(self._sensors)
        return _states(self._tracks, np.zeros(0, np.bool_), self._stamp_us or 0, self._frame, ended)

    def _check(self, looks: Sequence[Detections]) -> tuple[int, str]:
        """Their stamp and frame."""
        for look in looks:
            check(look)
        stamp_us, frame = looks[0].stamp_us, looks[0].frame if self._stamp_us is None else self._frame
        for look in looks:
            if look.frame != frame:
                raise InvalidInput(
                    f"detections in {look.frame} came to the tracker of {frame}",
                    "Transform all detections into one fixed frame, or use one map tracker for each.",
                )
            if look.stamp_us != stamp_us:
                raise InvalidInput(
                    f"detections at {look.stamp_us} us came with those at {stamp_us} us",
                    "Give each stamp a step of its own.",
                )
        return stamp_us, frame

    def _predicted(self, stamp_us: int) -> MapTracks:
        """The tracks at a stamp, before its detections."""
        if self._stamp_us is None or not len(self._tracks):
            return self._tracks
        step_s = (stamp_us - self._stamp_us) / 1e6
        motion = predict(self._tracks.motion, step_s, self._settings.walking.acceleration_density)
        motion = self._standing_still(motion, stamp_us)
        looks = np.zeros_like(self._tracks.looks)
        return replace(self._tracks, mean=motion.mean, covariance=motion.covariance, looks=looks)

    def _standing_still(self, motion: Gaussians, stamp_us: int) -> Gaussians:
        """With those as they are who stood when they went out of sight."""
        stays = rests(self._tracks, stamp_us, self._settings.patience)
        stays &= stamp_us - self._tracks.seen_us > RESTING_US
        mean = np.where(stays[:, None], self._tracks.mean, motion.mean)
        covariance = np.where(stays[:, None, None], self._tracks.covariance, motion.covariance)
        return Gaussians(mean, covariance)

    def _ended_and_amended(
        self, tracks: MapTracks, rivals: list[tuple[int, int]], *, is_watched: bool
    ) -> TrackStates:
        """Keeps the tracks that go on; says where they are, which are over, and what turns out.

        is_watched  a sensor has looked somewhere: else nobody is out of its sight
        """
        stamp_us, patience = self._stamp_us or 0, self._settings.patience
        patience = patience if is_watched else replace(patience, resting_us=0)
        merged = self._amender.merged_alive(tracks, stamp_us)
        is_gone = is_over(tracks, stamp_us, patience, self._settings.existence)
        for amendment in merged:
            is_gone |= tracks.number == amendment.track
        gone = tracks.chosen(is_gone & tracks.is_confirmed)
        self._tracks = tracks.chosen(~is_gone) if is_gone.any() else tracks
        found = self._amender.find(self._tracks, rivals, gone, stamp_us)
        seen = self._tracks.is_confirmed & (self._tracks.seen_us == stamp_us)
        return _states(self._tracks, seen, stamp_us, self._frame, _ended(gone), (*merged, *found))


def _counted(tracks: MapTracks, frames: Floats, pairs: Pairs) -> Floats:
    """(n,) as they are, and `frames` of those that were detected."""
    counted = tracks.frames.copy()
    counted[pairs.track] = frames[pairs.track]
    return counted


def _updated(
    tracks: MapTracks,
    detections: Detections,
    number: int,
    pairs: Pairs,
    covariance_m2: Floats,
    settings: MapTrackerSettings,
) -> MapTracks:
    """The tracks after what they were detected as.

    number         of the look in its moment
    covariance_m2  (n, m, 2, 2) of each detection as a measurement of each track
    """
    rows, columns = pairs.track, pairs.detection
    if not len(rows):
        return tracks
    seen = tracks if len(rows) == len(tracks) else tracks.chosen(rows)
    stamp_us, body = detections.stamp_us, settings.body
    before = less_certain(seen.motion, pairs.has_slipped, settings.association.slip_m)
    motion = update(before, detections.position_m[columns], covariance_m2[rows, columns])
    step_s = (stamp_us - seen.seen_us)[:, None] / 1e6
    extent_m, extent_m2 = next_extent(
        seen.extent_m, seen.extent_m2, detections.extent_m[columns], step_s, body
    )
    now = replace(
        seen,
        mean=motion.mean,
        covariance=motion.covariance,
        seen_us=np.full(len(rows), stamp_us),
        detections=seen.detections + 1,
        looks=seen.looks | 1 << number,
        seen_by=seen.seen_by | detections.seen_by[columns],
        extent_m=extent_m,
        extent_m2=extent_m2,
        heading_rad=heading(seen.heading_rad, motion.mean, motion.covariance, body),
    )
    return tracks.replaced(rows, now.hinted(detections.hint[columns], stamp_us))


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
