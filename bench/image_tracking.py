"""semap's image tracker beside SORT and ByteTrack on the same boxes: MOTA, IDF1 and HOTA by TrackEval.

On the sequences of the MOTChallenge that `--mot FOLDER` has, and on simulated ones. semap's tracker was tuned
on seeds 1 to 4, which are not among those here. SORT knows no scores, and is given the boxes from 0.5 on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.tracking.image_tracker import ImageTracker
from semap_service.evaluation.mot_scores import MotScores, Places, box_scores

from bench.figure import Rows, once
from bench.mot_sequences import Sequence, of_folder, simulated
from bench.mot_trackers import ByteTrack, Sort, Told

SEEDS = (11, 12, 13, 14)
FOR_SORT = 0.5


def semap() -> Callable[[Boxes], Told]:
    tracker = ImageTracker()

    def step(boxes: Boxes) -> Told:
        tracked = tracker.step(boxes)
        is_told = tracked.track >= 0
        return tracked.track[is_told], tracked.corners_px[is_told]

    return step


def sort() -> Callable[[Boxes], Told]:
    tracker = Sort()
    return lambda boxes: tracker.step(_from(boxes, FOR_SORT))


TRACKERS: dict[str, Callable[[], Callable[[Boxes], Told]]] = {
    "semap": semap,
    "SORT": sort,
    "ByteTrack": lambda: ByteTrack().step,
}


def measure(mot: Path | None) -> Rows:
    """A row for each sequence and tracker, then the means over the sequences of each kind."""
    rows: Rows = []
    for kind, sequences in kinds(mot):
        found: dict[str, list[MotScores]] = {name: [] for name in TRACKERS}
        for sequence in sequences:
            for name, make in TRACKERS.items():
                scores = evaluate(make(), sequence)
                found[name].append(scores)
                rows.append(_row(sequence.name, name, [scores]))
        rows += [_row(f"all {kind}", name, scores) for name, scores in found.items() if scores]
    return rows


def kinds(mot: Path | None) -> Iterable[tuple[str, Iterable[Sequence]]]:
    if mot is not None:
        yield "of the folder", of_folder(mot)
    yield "simulated", chain.from_iterable(simulated(seed) for seed in SEEDS)


def evaluate(step: Callable[[Boxes], Told], sequence: Sequence) -> MotScores:
    told: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []
    for boxes in sequence.frames:
        number, corners_px = step(boxes)
        told.append((np.full(len(number), boxes.stamp_us), number, corners_px))
    stamp_us, number, corners_px = (np.concatenate(column) for column in zip(*told, strict=True))
    return box_scores(sequence.truth, Places(stamp_us, number, corners_px))


def _row(sequence: str, tracker: str, scores: list[MotScores]) -> dict[str, object]:
    means = {
        title: once(float(np.mean([getattr(each, title) for each in scores])), 3)
        for title in ("mota", "idf1", "hota")
    }
    counts = {
        title: once(sum(getattr(each, title) for each in scores))
        for title in ("missed", "false_positives", "switches", "fragments", "persons", "tracks")
    }
    return {"sequence": sequence, "tracker": tracker} | means | counts


def _from(boxes: Boxes, score: float) -> Boxes:
    kept = np.flatnonzero(boxes.score >= score)
    return replace(
        boxes,
        corners_px=boxes.corners_px[kept],
        score=boxes.score[kept],
        label=("person",) * len(kept),
        track=boxes.track[kept],
    )
