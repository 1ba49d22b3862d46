"""Two trackers to compare with, as their authors wrote them: SORT and ByteTrack, over filterpy.

SORT (Bewley et al. 2016): centre, area and aspect of a box, one assignment by the Jaccard index from 0.3 on,
told after three images in a row with it. ByteTrack (Zhang et al. 2022): centre, aspect and height, boxes of
high score first and those of low score after them, lost tracks kept for 30 images. Both count images, not
seconds.
"""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.tracking.assignment import assign, unassigned
from semap_ingest.tracking.overlap import jaccard_index

Floats = NDArray[np.float64]
Told = tuple[NDArray[np.int64], Floats]


class Sort:
    """max_age 1, min_hits 3, iou_threshold 0.3, as published."""

    def __init__(self) -> None:
        self._tracks: list[_SortTrack] = []
        self._images = self._numbers = 0

    def step(self, boxes: Boxes) -> Told:
        """Numbers and corners of the tracks that are told of this image."""
        self._images += 1
        for track in self._tracks:
            track.predict()
        expected = np.array([track.corners for track in self._tracks]).reshape(-1, 4)
        rows, columns = assign(1 - jaccard_index(expected, boxes.corners_px), 0.7)
        for row, column in zip(rows, columns, strict=True):
            self._tracks[row].update(boxes.corners_px[column])
        for column in unassigned(len(boxes), columns):
            self._numbers += 1
            self._tracks.append(_SortTrack(self._numbers, boxes.corners_px[column]))
        self._tracks = [track for track in self._tracks if track.unseen <= 1]
        told = [
            track for track in self._tracks if track.unseen == 0 and (track.streak >= 3 or self._images <= 3)
        ]
        return np.array([each.number for each in told], np.int64), _stack([each.corners for each in told])


class _SortTrack:
    def __init__(self, number: int, corners: Floats) -> None:
        self.number, self.unseen, self.streak = number, 0, 0
        self._filter = KalmanFilter(dim_x=7, dim_z=4)
        self._filter.F = np.eye(7) + np.eye(7, k=4)
        self._filter.H = np.eye(4, 7)
        self._filter.R[2:, 2:] *= 10.0
        self._filter.P[4:, 4:] *= 1000.0
        self._filter.P *= 10.0
        self._filter.Q[-1, -1] *= 0.01
        self._filter.Q[4:, 4:] *= 0.01
        self._filter.x[:4, 0] = _area_and_aspect(corners)

    @property
    def corners(self) -> Floats:
        x, y, area, aspect = self._filter.x[:4, 0]
        width = np.sqrt(max(area, 1e-9) * max(aspect, 1e-9))
        half = np.array([width, max(area, 1e-9) / width]) / 2
        return np.array([x - half[0], y - half[1], x + half[0], y + half[1]])

    def predict(self) -> None:
        if self._filter.x[6, 0] + self._filter.x[2, 0] <= 0:
            self._filter.x[6, 0] = 0.0
        self._filter.predict()
        self.streak = self.streak if self.unseen == 0 else 0
        self.unseen += 1

    def update(self, corners: Floats) -> None:
        self.unseen = 0
        self.streak += 1
        self._filter.update(_area_and_aspect(corners)[:, None])


class ByteTrack:
    """track_thresh 0.6, track_buffer 30, match_thresh 0.9, as published."""

    def __init__(self) -> None:
        self._tracks: list[_ByteTrack] = []
        self._images = self._numbers = 0

    def step(self, boxes: Boxes) -> Told:
        self._images += 1
        for track in self._tracks:
            track.predict()
        free = np.flatnonzero(boxes.score > 0.6)
        known = [track for track in self._tracks if track.is_confirmed]
        left, free = self._round(known, boxes, free, 0.9, fused=True)
        low = np.flatnonzero((boxes.score > 0.1) & (boxes.score <= 0.6))
        self._round([track for track in left if track.unseen == 1], boxes, low, 0.5, fused=False)
        new = [track for track in self._tracks if not track.is_confirmed]
        unproved, free = self._round(new, boxes, free, 0.7, fused=True)
        for track in unproved:
            self._tracks.remove(track)
        for column in free[boxes.score[free] >= 0.7]:
            self._numbers += 1
            self._tracks.append(_ByteTrack(self._numbers, boxes.corners_px[column], self._images == 1))
        self._tracks = _without_doubles([track for track in self._tracks if track.unseen <= 30])
        told = [track for track in self._tracks if track.unseen == 0 and track.is_confirmed]
        return np.array([each.number for each in told], np.int64), _stack([each.corners for each in told])

    def _round(
        self, tracks: list[_ByteTrack], boxes: Boxes, free: NDArray[np.int64], most: float, *, fused: bool
    ) -> tuple[list[_ByteTrack], NDArray[np.int64]]:
        """Assign boxes; which tracks and which boxes are left."""
        likeness = jaccard_index(_stack([track.corners for track in tracks]), boxes.corners_px[free])
        if fused:
            likeness = likeness * boxes.score[free]
        rows, columns = assign(1 - likeness, most)
        for row, column in zip(rows, columns, strict=True):
            tracks[row].update(boxes.corners_px[free[column]])
        return [tracks[row] for row in unassigned(len(tracks), rows)], free[unassigned(len(free), columns)]


class _ByteTrack:
    def __init__(self, number: int, corners: Floats, is_confirmed: bool) -> None:
        self.number, self.is_confirmed = number, is_confirmed
        self.unseen = self.age = 0
        self._filter = KalmanFilter(dim_x=8, dim_z=4)
        self._filter.F = np.eye(8) + np.eye(8, k=4)
        self._filter.H = np.eye(4, 8)
        self._filter.x[:4, 0] = _aspect_and_height(corners)
        height = self._filter.x[3, 0]
        std = np.array([0.1, 0.1, 0.01 / height, 0.1, 0.0625, 0.0625, 1e-5 / height, 0.0625]) * height
        self._filter.P = np.diag(std**2)

    @property
    def corners(self) -> Floats:
        x, y, aspect, height = self._filter.x[:4, 0]
        half = np.array([aspect * height, height]) / 2
        return np.array([x - half[0], y - half[1], x + half[0], y + half[1]])

    def predict(self) -> None:
        if self.unseen:
            self._filter.x[7, 0] = 0.0
        height = self._filter.x[3, 0]
        std = np.array([0.05, 0.05, 0.01 / height, 0.05, 0.00625, 0.00625, 1e-5 / height, 0.00625]) * height
        self._filter.predict(Q=np.diag(std**2))
        self.unseen += 1
        self.age += 1

    def update(self, corners: Floats) -> None:
        height = self._filter.x[3, 0]
        std = np.array([0.05, 0.05, 0.1 / height, 0.05]) * height
        self._filter.update(_aspect_and_height(corners)[:, None], R=np.diag(std**2))
        self.unseen, self.is_confirmed = 0, True


def _without_doubles(tracks: list[_ByteTrack]) -> list[_ByteTrack]:
    """Of a track that is seen and one that is lost in the same place only the older."""
    seen = [track for track in tracks if track.unseen == 0]
    lost = [track for track in tracks if track.unseen]
    likeness = jaccard_index(_stack([each.corners for each in seen]), _stack([each.corners for each in lost]))
    pairs = [(seen[row], lost[column]) for row, column in np.argwhere(likeness > 0.85)]
    doubles = {id(min(pair, key=lambda each: each.age - each.unseen)) for pair in pairs}
    return [track for track in tracks if id(track) not in doubles]


def _stack(corners: list[Floats]) -> Floats:
    return np.array(corners, np.float64).reshape(-1, 4)


def _area_and_aspect(corners: Floats) -> Floats:
    width, height = corners[2:] - corners[:2]
    return np.array([*(corners[:2] + corners[2:]) / 2, width * height, width / height])


def _aspect_and_height(corners: Floats) -> Floats:
    width, height = corners[2:] - corners[:2]
    return np.array([*(corners[:2] + corners[2:]) / 2, width / height, height])
