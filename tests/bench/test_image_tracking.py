"""What the benchmark of the image tracker compares, and that semap is ahead of SORT there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from semap_service.evaluation.mot_scores import MotScores, Places, box_scores

from bench.image_tracking import TRACKERS, evaluate
from bench.mot_sequences import boxes, of_folder, simulated

SEED = 5
"""Nothing was tuned on it."""


@pytest.fixture(scope="module")
def scores() -> dict[str, list[MotScores]]:
    sequences = list(simulated(SEED))
    return {name: [evaluate(make(), each) for each in sequences] for name, make in TRACKERS.items()}


@pytest.mark.parametrize("title", ["mota", "idf1", "hota"])
def test_semap_is_ahead_of_sort(scores: dict[str, list[MotScores]], title: str) -> None:
    ours, sort = (np.mean([getattr(each, title) for each in scores[name]]) for name in ("semap", "SORT"))
    assert ours > sort


def test_sort_and_bytetrack_follow_one_who_walks_past() -> None:
    corners_px = np.array([[100.0, 100, 140, 200]])
    for name in ("SORT", "ByteTrack"):
        step = TRACKERS[name]()
        told = [
            step(boxes(40_000 * n, corners_px + np.array([4.0 * n, 0, 4.0 * n, 0]), np.array([0.95])))
            for n in range(20)
        ]
        assert [number.tolist() for number, _ in told] == [[1]] * 20
        assert np.abs(told[-1][1] - corners_px - [76, 0, 76, 0]).max() < 2.0


def test_the_text_files_of_the_motchallenge(tmp_path: Path) -> None:
    for kind, lines in {
        "gt": "1,7,10,20,30,40,1,1,1\n1,8,0,0,5,5,0,1,1\n1,9,0,0,5,5,1,3,1\n2,7,11,20,30,40,1,1,1\n",
        "det": "2,-1,12,20,30,40,0.7,-1,-1,-1\n",
    }.items():
        (tmp_path / "MOT" / kind).mkdir(parents=True)
        (tmp_path / "MOT" / kind / f"{kind}.txt").write_text(lines)
    (tmp_path / "MOT" / "seqinfo.ini").write_text("[Sequence]\nframeRate=20\n")
    (sequence,) = of_folder(tmp_path)
    assert sequence.truth.stamp_us.tolist() == [50_000, 100_000]
    assert sequence.truth.identity.tolist() == [7, 7]
    assert sequence.truth.position_m.tolist() == [[10, 20, 40, 60], [11, 20, 41, 60]]
    assert [frame.stamp_us for frame in sequence.frames] == [50_000, 100_000]
    assert [frame.corners_px.tolist() for frame in sequence.frames] == [[], [[12, 20, 42, 60]]]


def test_boxes_are_alike_by_their_jaccard_index() -> None:
    truth = Places(np.array([0, 1]), np.array([1, 1]), np.array([[0.0, 0, 10, 10], [0, 0, 10, 10]]))
    told = Places(np.array([0, 1]), np.array([3, 3]), np.array([[0.0, 0, 10, 10], [0, 0, 10, 4.9]]))
    found = box_scores(truth, told)
    assert (found.missed, found.false_positives, found.switches) == (1, 1, 0)
    assert found.distance_m == pytest.approx(0.0)
