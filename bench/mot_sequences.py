"""Sequences of boxes whose truth is known, in the form of the MOTChallenge or simulated.

A folder of the MOTChallenge has for each sequence `det/det.txt` and `gt/gt.txt` (frame, identity, left, top,
width, height, score or flag, ...) and may have `seqinfo.ini` with the rate.

Simulated are cameras in the office, and what a detector makes of whom they see. It scores by how much of a
person is visible, with an error that lasts for a while, and says nothing below 0.1; its boxes jitter, and are
merged where two persons nearly cover one another; parts of persons and things that look like some get boxes
too. Its scores are thus more honest than many a network's. Truth is who is visible by a tenth or more.
"""

from __future__ import annotations

from collections.abc import Iterator
from configparser import ConfigParser
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.simulation.figure import figures
from semap_ingest.simulation.moment import Moment
from semap_ingest.simulation.ray import is_crossed
from semap_ingest.simulation.schedule import Moments, moments
from semap_ingest.simulation.settings import OfficeSettings
from semap_ingest.simulation.wall_sensors import FOCAL_PX, HEIGHT_PX, WIDTH_PX, WallCamera
from semap_ingest.tracking.overlap import jaccard_index
from semap_service.evaluation.mot_scores import Places

Floats = NDArray[np.float64]

PEOPLE, SECONDS = 20, 60.0
CAMERAS = {
    "hall": WallCamera(1, (1.2, 5.1, 2.4, 0.0, 0.38), 1 / 15, 0.0, 0.0),
    "eye level": WallCamera(2, (18.8, 5.1, 1.5, np.pi, 0.0), 1 / 30, 0.0, 0.0),
    "slow": WallCamera(3, (10.0, 6.0, 1.5, np.pi, 0.0), 1 / 7.5, 0.0, 0.0),
}
JITTER = {"hall": 0.025, "eye level": 0.07, "slow": 0.045}
"""Of a box's edges, of its size: once from image to image, and once more for a while."""
GRID_PX = 4
LEAST_VISIBLE = 0.1
RATE_HZ = 25.0
"""Of a sequence that does not say its own: that of both sequences of TUD."""


@dataclass(frozen=True, eq=False)
class Sequence:
    name: str
    rate_hz: float
    truth: Places
    frames: list[Boxes]


def of_folder(folder: Path) -> Iterator[Sequence]:
    """The sequences of the MOTChallenge in a folder."""
    for file in sorted(folder.glob("*/gt/gt.txt")):
        home = file.parents[1]
        info = ConfigParser()
        info.read(home / "seqinfo.ini")
        rate_hz = info.getfloat("Sequence", "frameRate", fallback=RATE_HZ)
        truth = np.loadtxt(file, delimiter=",", ndmin=2)
        is_person = truth[:, 6] != 0
        if truth.shape[1] == 9:  # from MOT16 on with classes: 1 is a pedestrian
            is_person &= truth[:, 7] == 1
        truth = truth[is_person]
        found = np.loadtxt(home / "det" / "det.txt", delimiter=",", ndmin=2)
        last = int(max(truth[:, 0].max(), found[:, 0].max()))
        frames = []
        for frame in range(1, last + 1):
            rows = found[found[:, 0] == frame]
            frames.append(boxes(_stamp_us(frame, rate_hz), _corners(rows), rows[:, 6]))
        stamps_us = np.array([_stamp_us(frame, rate_hz) for frame in truth[:, 0]], np.int64)
        yield Sequence(
            home.name, rate_hz, Places(stamps_us, truth[:, 1].astype(np.int64), _corners(truth)), frames
        )


def boxes(stamp_us: int, corners_px: Floats, score: Floats) -> Boxes:
    return Boxes(stamp_us, "camera", corners_px, score, ("person",) * len(score), np.full(len(score), -1))


def simulated(seed: int) -> Iterator[Sequence]:
    """One sequence for each of the cameras."""
    course = moments(OfficeSettings(seed=seed, people=PEOPLE, duration_s=93.0, camera=False))
    for name, camera in CAMERAS.items():
        random = np.random.default_rng([seed, camera.number])
        detector = Detector(PEOPLE, camera.period_s, JITTER[name], random)
        yield _seen_by(camera, f"{name}, seed {seed}", course, detector)


def _seen_by(camera: WallCamera, name: str, course: Moments, detector: Detector) -> Sequence:
    stamps: list[int] = []
    persons: list[NDArray[np.int64]] = []
    places: list[Floats] = []
    frames = []
    for frame in range(round(SECONDS / camera.period_s)):
        corners_px, depth_m = _in_image(camera, course, course.at(frame * camera.period_s))
        visible = _visible(corners_px, depth_m)
        stamp_us = _stamp_us(frame, 1 / camera.period_s)
        who = np.flatnonzero(visible >= LEAST_VISIBLE)
        stamps += [stamp_us] * len(who)
        persons.append(who)
        places.append(corners_px[who])
        frames.append(boxes(stamp_us, *detector.look(corners_px, depth_m, visible)))
    truth = Places(np.array(stamps, np.int64), np.concatenate(persons), np.concatenate(places))
    return Sequence(name, 1 / camera.period_s, truth, frames)


def _in_image(camera: WallCamera, course: Moments, moment: Moment) -> tuple[Floats, Floats]:
    """(n, 4) corners [px], NaN: out of the image or behind a wall; (n,) depth [m]."""
    people = figures(moment.bodies)
    eye_m = np.array(camera.place[:3])
    centre = (people.centre_m - eye_m) @ camera.turn.as_matrix()
    depth = np.maximum(centre[..., 2], 1e-3)
    middle = FOCAL_PX * centre[..., :2] / depth[..., None] + [(WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2]
    radius = (FOCAL_PX * people.radius_m / depth)[..., None]
    whole = np.hstack([(middle - radius).min(axis=1), (middle + radius).max(axis=1)])
    corners_px = np.clip(whole, 0.0, np.array([WIDTH_PX, HEIGHT_PX, WIDTH_PX, HEIGHT_PX]) - 1.0)
    is_seen = (centre[..., 2] > 0.5).all(axis=1)
    is_seen &= ((corners_px[:, 2:] - corners_px[:, :2]) >= 0.5 * (whole[:, 2:] - whole[:, :2])).all(axis=1)
    middles_m = np.array([body.position_m for body in moment.bodies])
    is_seen &= ~is_crossed(eye_m[:2], middles_m, course.floor.sight_segments)
    is_seen &= ~is_crossed(eye_m[:2], middles_m, course.floor.leaves(moment.door_rad).segments_m)
    corners_px[~is_seen] = np.nan
    return corners_px, centre[..., 2].mean(axis=1)


def _visible(corners_px: Floats, depth_m: Floats) -> Floats:
    """(n,) the share of each box that no nearer one covers; 0 where there is none."""
    owner = np.full((HEIGHT_PX // GRID_PX, WIDTH_PX // GRID_PX), -1)
    share = np.zeros(len(corners_px))
    seen = [row for row in np.argsort(-depth_m) if np.isfinite(corners_px[row]).all()]
    cells = {row: _cells(corners_px[row]) for row in seen}
    for row in seen:
        owner[cells[row]] = row
    for row in seen:
        share[row] = np.mean(owner[cells[row]] == row)
    return share


def _cells(corners_px: Floats) -> tuple[slice, slice]:
    """Rows and columns of the grid; the middle two thirds of the width, as people are no rectangles."""
    left, top, right, bottom = corners_px / GRID_PX
    inset = (right - left) / 6
    columns = slice(int(left + inset), max(int(right - inset), int(left + inset) + 1))
    return slice(int(top), max(int(bottom), int(top) + 1)), columns


class Detector:
    """A detector's errors."""

    def __init__(self, people: int, period_s: float, jitter: float, random: np.random.Generator) -> None:
        self._jitter, self._random = jitter, random
        self._keep = np.exp(-period_s / 0.3)
        self._lasting = random.standard_normal((people, 5))
        self._things = random.uniform([0, 100, 20, 50], [WIDTH_PX - 80, 250, 70, 180], (2, 4))

    def look(self, corners_px: Floats, depth_m: Floats, visible: Floats) -> tuple[Floats, Floats]:
        """Boxes and their scores."""
        random = self._random
        fresh = random.standard_normal(self._lasting.shape)
        self._lasting = self._keep * self._lasting + np.sqrt(1 - self._keep**2) * fresh
        who = np.flatnonzero(visible > 0)
        place = corners_px[who]
        size = np.tile(place[:, 2:] - place[:, :2], 2)
        error = self._jitter * (self._lasting[who, 1:] + random.standard_normal((len(who), 4)))
        place = place + size * error
        log_odds = (
            7.0 * visible[who] - 2.2 + 1.2 * self._lasting[who, 0] + 0.7 * random.standard_normal(len(who))
        )
        score = 1 / (1 + np.exp(-log_odds))
        place, score = self._merged(place, score, depth_m[who])
        place, score = self._with_false(place, score)
        kept = score >= 0.1
        return place[kept], score[kept]

    def _merged(self, place: Floats, score: Floats, depth_m: Floats) -> tuple[Floats, Floats]:
        """Of two that nearly cover one another the farther has no box, the other at times that of both."""
        overlap = jaccard_index(place, place)
        place, score = place.copy(), score.copy()
        for near, far in np.argwhere((overlap > 0.5) & (depth_m[:, None] < depth_m[None, :])):
            if self._random.random() < 0.3:
                place[near] = np.concatenate(
                    [np.minimum(place[near, :2], place[far, :2]), np.maximum(place[near, 2:], place[far, 2:])]
                )
            score[far] = 0.0
        return place, score

    def _with_false(self, place: Floats, score: Floats) -> tuple[Floats, Floats]:
        """Parts of persons, what looks like one in its place, and what is there once."""
        random = self._random
        parts = place[(random.random(len(place)) < 0.05) & (score > 0.1)].copy()
        parts[:, 3] -= random.uniform(0.3, 0.6, len(parts)) * (parts[:, 3] - parts[:, 1])
        things = self._things[random.random(len(self._things)) < 0.4]
        things = np.hstack([things[:, :2], things[:, :2] + things[:, 2:]])
        things = things + random.normal(0, 2, things.shape)
        stray = random.uniform([0, 50], [WIDTH_PX - 80, 250], (random.poisson(0.15), 2))
        stray = np.hstack([stray, stray + random.uniform([20, 50], [80, 200], stray.shape)])
        false = np.vstack([parts, things, stray])
        return np.vstack([place, false]), np.concatenate([score, random.beta(2.5, 3.0, len(false))])


def _corners(rows: Floats) -> Floats:
    return np.hstack([rows[:, 2:4], rows[:, 2:4] + rows[:, 4:6]])


def _stamp_us(frame: float, rate_hz: float) -> int:
    return round(frame * 1e6 / rate_hz)
