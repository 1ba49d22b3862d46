"""Measure the person detector of the simulated camera on rendered images that it was not trained on.

python -m ingest.training.person_figures    (from the repository's root; prints the table of its model card)
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from semap_ingest.image.detector import ImageDetector
from semap_ingest.sensing.image import Image
from semap_ingest.simulation.camera_view import View

from ingest.training.person_scenes import HELD_OUT_OFFICE_SEEDS, HELD_OUT_SEEDS, office_views, views

Floats = NDArray[np.float64]

MODEL = Path(__file__).parents[1] / "semap_ingest" / "models" / "person_camera.onnx"
WORKING_SCORE = 0.4

LEAST_VISIBLE = 0.25
"""Persons of whom less is seen may be found or not."""


@dataclass(frozen=True)
class Figures:
    """What a detector is worth; all but the average precision at its working score.

    recall          of persons of whom a quarter or more is seen
    bottom, middle  errors of the box's lower edge and of its middle [px], of persons who are seen whole
    """

    images: int
    persons: int
    average_precision_50: float
    average_precision_75: float
    recall: float
    recall_mostly_seen: float
    recall_half_seen: float
    false_positives_per_image: float
    bottom_bias_px: float
    bottom_std_px: float
    middle_bias_px: float
    middle_std_px: float
    ms_per_image: float


@dataclass(frozen=True, eq=False)
class _Judged:
    """One image: its boxes by falling score, and the person of each as `matches` gives it."""

    score: Floats
    person_50: NDArray[np.int64]
    person_75: NDArray[np.int64]


def measure(seen: Iterable[View], detector: ImageDetector, working_score: float = WORKING_SCORE) -> Figures:
    """detector  opened with a low min_score, so that precision can be averaged over all scores"""
    judged: list[_Judged] = []
    counted: list[int] = []
    found_share: list[tuple[float, bool]] = []
    errors: list[Floats] = []
    spent_s = 0.0
    for view in seen:
        began = time.process_time()
        boxes = detector.detect(Image(0, "camera", view.pixels))
        spent_s += time.process_time() - began
        order = np.argsort(-boxes.score, kind="stable")
        corners, score = boxes.corners_px[order], boxes.score[order]
        overlap = overlaps(corners, view.corners_px)
        is_asked = view.visible >= LEAST_VISIBLE
        image = _Judged(score, *(matches(overlap, is_asked, least) for least in (0.5, 0.75)))
        judged.append(image)
        counted.append(int(is_asked.sum()))
        working = image.person_50[score >= working_score]
        found_share += [(float(view.visible[k]), k in working) for k in np.flatnonzero(is_asked)]
        errors.append(_errors(corners[score >= working_score], working, view))
    error = np.concatenate(errors)
    people = sum(counted)
    score, hits_50, hits_75 = (
        np.concatenate(column)
        for column in zip(*((one.score, one.person_50, one.person_75) for one in judged), strict=True)
    )
    false = (hits_50 == -1) & (score >= working_score)
    bottom, middle = error.T
    return Figures(
        images=len(judged),
        persons=people,
        average_precision_50=average_precision(score, hits_50, people),
        average_precision_75=average_precision(score, hits_75, people),
        recall=_recall(found_share, LEAST_VISIBLE, 1.0),
        recall_mostly_seen=_recall(found_share, 0.75, 1.0),
        recall_half_seen=_recall(found_share, LEAST_VISIBLE, 0.5),
        false_positives_per_image=float(false.sum()) / len(judged),
        bottom_bias_px=float(bottom.mean()),
        bottom_std_px=float(bottom.std()),
        middle_bias_px=float(middle.mean()),
        middle_std_px=float(middle.std()),
        ms_per_image=1e3 * spent_s / len(judged),
    )


def _recall(found_share: list[tuple[float, bool]], low: float, high: float) -> float:
    """Of persons of whom a share from low to high is seen; NaN where there are none."""
    found = [was_found for share, was_found in found_share if low <= share <= high]
    return float(np.mean(found)) if found else np.nan


def overlaps(one: Floats, other: Floats) -> Floats:
    """(n, m), intersection over union of corners (n, 4) and (m, 4)."""
    low = np.maximum(one[:, None, :2], other[None, :, :2])
    high = np.minimum(one[:, None, 2:], other[None, :, 2:])
    common = np.clip(high - low, 0, None).prod(axis=2)
    areas = [(corners[:, 2:] - corners[:, :2]).prod(axis=1) for corners in (one, other)]
    shared: Floats = common / (areas[0][:, None] + areas[1][None, :] - common)
    return shared


def matches(overlap: Floats, is_asked: NDArray[np.bool_], least: float) -> NDArray[np.int64]:
    """The person of each box, best boxes first; -1 none; -2 one that is hardly seen."""
    person = np.full(len(overlap), -1)
    free = is_asked.copy()
    for k, row in enumerate(overlap):
        best = int(np.argmax(np.where(free, row, -1))) if free.any() else -1
        if best >= 0 and row[best] >= least:
            person[k], free[best] = best, False
        elif (row[~is_asked] >= least).any():
            person[k] = -2
    return person


def average_precision(score: Floats, person: NDArray[np.int64], people: int) -> float:
    """Area below the precision that is at least reached at each recall."""
    order = np.argsort(-score, kind="stable")
    kept = person[order][person[order] != -2] >= 0
    recall, precision = np.cumsum(kept) / people, np.cumsum(kept) / np.arange(1, len(kept) + 1)
    reached = np.maximum.accumulate(precision[::-1])[::-1]
    return float(np.sum(np.diff(recall, prepend=0.0) * reached))


def _errors(corners: Floats, person: NDArray[np.int64], view: View) -> Floats:
    """(k, 2) of the lower edge and of the middle [px]."""
    height, width = view.pixels.shape[:2]
    true = view.corners_px[person[person >= 0]]
    found = corners[person >= 0]
    rim = np.array([width, height, width, height]) - 2.0
    is_whole = (view.visible[person[person >= 0]] > 0.95) & (true > 1).all(axis=1) & (true < rim).all(axis=1)
    difference = (found - true)[is_whole]
    return np.column_stack([difference[:, 3], (difference[:, 0] + difference[:, 2]) / 2])


def main() -> None:
    detector = ImageDetector.open(MODEL, min_score=0.02)
    places = measure((view for seed in HELD_OUT_SEEDS for view in views(seed)), detector)
    office = measure((view for seed in HELD_OUT_OFFICE_SEEDS for view in office_views(seed, 0.5)), detector)
    for field in fields(Figures):
        print(f"{field.name:28} {getattr(places, field.name):10.3f} {getattr(office, field.name):10.3f}")  # noqa: T201


if __name__ == "__main__":
    main()
