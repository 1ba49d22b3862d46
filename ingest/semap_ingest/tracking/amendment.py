"""What a map tracker had mistaken before and finds out now.

Merged, while both live: for `merge_us` and `merge_frames` without a break two confirmed tracks were nearer
to one another than two bodies can be and went at the same velocity, each was detected in some look of a
sensor and never both in one, and they had not different hints of one sensor at a time (a hint is who it is
to the sensor, such as an image track). The younger is over; the older goes on. It is said to hold from when
they came together, or from the younger's beginning.

Merged, one after the other: a track is over, and one that began after the first was last seen, no further
than a person comes in that time, has had the first's hint since. The younger goes on under its own
number. It is said to hold from the younger's beginning.

Switched: two confirmed tracks have each had a hint of a sensor (their home) for `home_frames`. Then each
was seen with the home of the other, for `switch_us` and in `switch_frames` frames, without once being seen
with its own. And after both were last seen with their own they were rivals for a detection of which no hint
told whose it is, so that the map tracker may well have been wrong; where it was never in doubt, the sensor
has mistaken them, and nothing is said. What one sensor's hints tell is not told again by another's. It
holds from the first frame in which one of the two was seen with the home of the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.track_states import TrackAmendment
from semap_ingest.tracking.map_tracks import MapTracks

Pair = tuple[int, int]


@dataclass(frozen=True)
class Evidence:
    """How much it takes; the opening of `amendment` says of what.

    remembered_us          for how long a track that is over is compared with new ones
    reach_m, reach_mps     how far from where it was last seen a person may come to light again
    """

    merge_distance_m: float = 0.3
    merge_speed_mps: float = 0.5
    merge_us: int = 1_000_000
    merge_frames: int = 10
    remembered_us: int = 10_000_000
    reach_m: float = 0.5
    reach_mps: float = 1.5
    home_frames: int = 5
    switch_us: int = 700_000
    switch_frames: int = 5


@dataclass(frozen=True)
class _Together:
    """A pair that may be one person: since when, in how many frames each of them was detected."""

    since_us: int
    first: int = 0
    second: int = 0


@dataclass(frozen=True)
class _Follows:
    """Which hint of a sensor a track has had: `home`, and another one since it was last seen with that."""

    home: int
    home_frames: int
    home_seen_us: int
    other: int = -1
    other_frames: int = 0
    since_us: int = 0

    def seen(self, hint: int, stamp_us: int) -> _Follows:
        if hint == self.home:
            return _Follows(self.home, self.home_frames + 1, stamp_us)
        if hint == self.other:
            return replace(self, other_frames=self.other_frames + 1)
        return replace(self, other=hint, other_frames=1, since_us=stamp_us)

    def moved(self, stamp_us: int) -> _Follows:
        return _Follows(self.other, self.other_frames, stamp_us)


@dataclass(frozen=True, eq=False)
class _Over:
    seen_us: int
    position_m: NDArray[np.float64]
    hint: int


class Amender:
    """What is remembered of confirmed tracks, by their numbers, to find mistakes.

    In a step `merged_alive` comes first, then, when the tracks that are over are gone, `find`.
    """

    def __init__(self, evidence: Evidence) -> None:
        self._evidence = evidence
        self._together: dict[Pair, _Together] = {}
        self._follows: dict[tuple[int, int], _Follows] = {}
        """By a track's number and the sensor whose hints they are."""
        self._rivals: dict[Pair, int] = {}
        self._over: dict[tuple[int, int], _Over] = {}
        self._joined: set[int] = set()

    def merged_alive(self, tracks: MapTracks, stamp_us: int) -> list[TrackAmendment]:
        """The pairs of confirmed tracks that turn out to be one person now.

        tracks  after the detections of that stamp
        """
        rows = np.flatnonzero(tracks.is_confirmed)
        together: dict[Pair, _Together] = {}
        found = []
        merged: set[int] = set()
        for first, second in _close_pairs(tracks, rows, stamp_us, self._evidence):
            older, younger = int(tracks.number[first]), int(tracks.number[second])
            before = self._together.get((older, younger), _Together(stamp_us))
            now = _Together(
                before.since_us,
                before.first + int(tracks.seen_us[first] == stamp_us),
                before.second + int(tracks.seen_us[second] == stamp_us),
            )
            together[older, younger] = now
            if self._is_one(now, stamp_us) and not merged & {older, younger}:
                merged |= {older, younger}
                since_us = max(now.since_us, int(tracks.begun_us[second]))
                found.append(TrackAmendment("merged", younger, older, since_us, stamp_us))
        self._together = together
        return found

    def _is_one(self, pair: _Together, stamp_us: int) -> bool:
        evidence = self._evidence
        return (
            stamp_us - pair.since_us >= evidence.merge_us
            and pair.first + pair.second >= evidence.merge_frames
            and min(pair.first, pair.second) > 0
        )

    def find(
        self, tracks: MapTracks, rivals: Iterable[Pair], over: MapTracks, stamp_us: int
    ) -> list[TrackAmendment]:
        """What else turns out.

        tracks  those that go on
        rivals  numbers of confirmed tracks that could have been mistaken at this stamp
        over    the confirmed ones that do not
        """
        for first, second in rivals:
            self._rivals[min(first, second), max(first, second)] = stamp_us
        unseen_s = (stamp_us - over.seen_us)[:, None] / 1e6
        last_m = over.mean[:, :2] - over.mean[:, 2:] * unseen_s
        for number, seen_us, place_m in zip(over.number.tolist(), over.seen_us.tolist(), last_m, strict=True):
            for sensor in range(over.hint.shape[1]):
                follows = self._follows.get((number, sensor))
                if follows is not None and self._is_at_home(follows):
                    self._over[number, sensor] = _Over(seen_us, place_m, follows.home)
        tracks = tracks if tracks.is_confirmed.all() else tracks.chosen(tracks.is_confirmed)
        self._forget(tracks, stamp_us)
        self._follow(tracks, stamp_us)
        return self._merged_in_turn(tracks, stamp_us) + self._switched(stamp_us)

    def _forget(self, tracks: MapTracks, stamp_us: int) -> None:
        """What can play no part any more."""
        alive = set(tracks.number.tolist())
        oldest_us = stamp_us - self._evidence.remembered_us
        self._over = {key: one for key, one in self._over.items() if one.seen_us >= oldest_us}
        self._rivals = {
            pair: last_us
            for pair, last_us in self._rivals.items()
            if last_us >= oldest_us and alive >= {*pair}
        }
        self._follows = {key: follows for key, follows in self._follows.items() if key[0] in alive}
        self._joined &= alive

    def _follow(self, tracks: MapTracks, stamp_us: int) -> None:
        for row, sensor in np.argwhere((tracks.hinted_us == stamp_us) & (tracks.hint >= 0)).tolist():
            key, hint = (int(tracks.number[row]), sensor), int(tracks.hint[row, sensor])
            before = self._follows.get(key)
            self._follows[key] = (
                _Follows(hint, 1, stamp_us) if before is None else before.seen(hint, stamp_us)
            )

    def _merged_in_turn(self, tracks: MapTracks, stamp_us: int) -> list[TrackAmendment]:
        by_hint = {one.hint: key for key, one in self._over.items()}
        row_of = {number: row for row, number in enumerate(tracks.number.tolist())} if by_hint else {}
        found = []
        for (number, _), follows in sorted(self._follows.items()) if by_hint else ():
            if number in self._joined or number not in row_of or not self._is_at_home(follows):
                continue
            other, row = by_hint.get(follows.home), row_of[number]
            began_us = int(tracks.begun_us[row])
            if other is not None and self._comes(self._over[other], began_us, tracks.begun_m[row]):
                found.append(TrackAmendment("merged", number, other[0], began_us, stamp_us))
                self._joined.add(number)
                self._over = {key: one for key, one in self._over.items() if key[0] != other[0]}
                by_hint = {one.hint: key for key, one in self._over.items()}
        return found

    def _is_at_home(self, follows: _Follows) -> bool:
        return follows.home_frames >= self._evidence.home_frames and follows.other < 0

    def _comes(self, over: _Over, began_us: int, begun_m: NDArray[np.float64]) -> bool:
        """Whether a person last seen there can be the one that came to light here."""
        gap_s = (began_us - over.seen_us) / 1e6
        reach_m = self._evidence.reach_m + self._evidence.reach_mps * gap_s
        way_m = float(np.hypot(*(begun_m - over.position_m)))
        return gap_s > 0 and way_m <= reach_m

    def _switched(self, stamp_us: int) -> list[TrackAmendment]:
        """Switches found now. Who has stayed with another hint is at home there from now on."""
        evidence = self._evidence
        owner = {follows.home: key for key, follows in self._follows.items()}
        stayed = [
            key
            for key, follows in self._follows.items()
            if follows.other_frames >= evidence.switch_frames
            and stamp_us - follows.since_us >= evidence.switch_us
        ]
        found = []
        for key in sorted(stayed):
            here = self._follows.get(key)
            if here is None or here.other < 0:
                continue
            other = owner.get(here.other)
            there = None if other is None else self._follows.get(other)
            if other is None or there is None or other == key:
                self._follows[key] = here.moved(stamp_us)
            elif other in stayed and there.other == here.home:
                pair = (min(key[0], other[0]), max(key[0], other[0]))
                self._follows[key], self._follows[other] = here.moved(stamp_us), there.moved(stamp_us)
                if self._was_in_doubt(pair, here, there):
                    since_us = min(here.since_us, there.since_us)
                    found.append(TrackAmendment("switched", pair[1], pair[0], since_us, stamp_us))
                    self._forget_elsewhere(pair, key[1])
        return found

    def _forget_elsewhere(self, pair: Pair, sensor: int) -> None:
        """What other sensors would tell of two tracks that one has told already."""
        self._follows = {
            key: follows for key, follows in self._follows.items() if key[0] not in pair or key[1] == sensor
        }

    def _was_in_doubt(self, pair: Pair, here: _Follows, there: _Follows) -> bool:
        last_us = self._rivals.get(pair)
        return (
            last_us is not None
            and last_us > max(here.home_seen_us, there.home_seen_us)
            and min(here.home_frames, there.home_frames) >= self._evidence.home_frames
        )


def _close_pairs(
    tracks: MapTracks, rows: NDArray[np.int64], stamp_us: int, evidence: Evidence
) -> Sequence[Pair]:
    """Pairs of rows, the older first, that one person may stand behind as far as this frame tells."""
    rows = rows[np.argsort(tracks.number[rows])]
    offset = tracks.mean[rows, None, :] - tracks.mean[None, rows, :]
    is_close = np.hypot(offset[..., 0], offset[..., 1]) < evidence.merge_distance_m
    is_close &= np.hypot(offset[..., 2], offset[..., 3]) < evidence.merge_speed_mps
    looks = tracks.looks[rows]
    is_close &= (looks[:, None] & looks[None, :]) == 0
    is_hinted = (tracks.hint[rows] >= 0) & (stamp_us - tracks.hinted_us[rows] <= evidence.merge_us)
    differs = tracks.hint[rows][:, None] != tracks.hint[rows][None, :]
    is_close &= ~(is_hinted[:, None] & is_hinted[None, :] & differs).any(axis=2)
    first, second = np.nonzero(is_close)
    is_older = first < second
    return list(zip(rows[first[is_older]].tolist(), rows[second[is_older]].tolist(), strict=True))
