"""What the leg classifier is trained with; on a slice of the bags with a small forest."""

from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from data_sets import data_set
from laser.leg_scene import cast
from sklearn.metrics import roc_auc_score

from ingest.training.leg_samples import (
    BAGS,
    EMPTY_BAG,
    LEG,
    OTHER,
    Samples,
    marked_beams,
    mirrored,
    read_empty,
    read_samples,
    still_share,
)
from ingest.training.legs import Forest, cross_validate, export, joined, table, thinned, train

FOLDER = "laser_people/training_scans_res_0.33"
SMALL = Forest(trees=8, depth=6, leaf=10)


@pytest.fixture(scope="module")
def samples() -> dict[str, Samples]:
    folder = data_set(FOLDER)
    chosen = [bag for bag in BAGS if bag.name in ("positive_2", "positive_6")]
    return {bag.name: read_samples(folder, bag, every=8) for bag in chosen} | {
        EMPTY_BAG: read_empty(folder, 160)
    }


def test_marks_become_labels_of_the_cluster_that_they_are_the_middle_of(samples: dict[str, Samples]) -> None:
    for name in ("positive_2", "positive_6"):
        judged = samples[name][samples[name].is_judged]
        assert (judged.label == LEG).sum() > 10
        assert (judged.features[judged.label == LEG, 0] >= 3).all()
    assert set(samples[EMPTY_BAG].label.tolist()) == {OTHER}


def test_a_forest_of_one_place_knows_legs_of_another(samples: dict[str, Samples]) -> None:
    judged = list(cross_validate(samples, [["positive_2"], ["positive_6"]], SMALL))
    assert [name for name, _ in judged] == ["positive_2", "positive_6"]
    assert all(roc_auc_score(each.is_leg, each.score) > 0.7 for _, each in judged)
    rows = table(judged).splitlines()
    assert [row.split("|")[1].strip() for row in rows[2:]] == [
        "positive_2",
        "positive_6",
        "pooled, bags with people",
        "pooled, all",
        "mean, bags with people",
    ]


def test_the_file_is_the_forest_and_the_same_each_time(samples: dict[str, Samples], tmp_path: Path) -> None:
    learnt = joined([thinned(each, 8) for each in samples.values()])
    forest = train(learnt, SMALL)
    export(forest, tmp_path / "one.onnx")
    export(train(learnt, SMALL), tmp_path / "other.onnx")
    assert (tmp_path / "one.onnx").read_bytes() == (tmp_path / "other.onnx").read_bytes()
    session = onnxruntime.InferenceSession(tmp_path / "one.onnx", providers=["CPUExecutionProvider"])
    (scores,) = session.run(["probabilities"], {"features": learnt.features})
    np.testing.assert_allclose(scores, forest.predict_proba(learnt.features), atol=1e-5)


def test_a_mark_tells_the_beams_of_its_cluster() -> None:
    scan = cast(np.array([[2.0, 0.3], [1.5, -0.6]]), wall_m=4.0)
    is_leg = scan.ranges_m < 3.5
    is_first = is_leg & (scan.angles_rad > 0)
    middle = scan.points_m[is_first].mean(axis=0)
    np.testing.assert_array_equal(marked_beams(scan, middle[None]), is_first)
    assert not marked_beams(scan, middle[None] + 0.01).any()


def test_what_stands_still_is_measured_again_and_again() -> None:
    walked = [cast(np.array([[2.0, y]]), wall_m=4.0) for y in np.linspace(-1.5, 1.5, 20)]
    share = still_share(walked)
    for scan, of_beam in zip(walked, share, strict=True):
        assert (of_beam[scan.ranges_m < 3.5] < 0.3).all()
        assert (of_beam[scan.ranges_m > 3.5] > 0.7).all()


def test_a_mirrored_scan_is_a_mirrored_world() -> None:
    scan = cast(np.array([[2.0, 0.3]]), wall_m=4.0)
    np.testing.assert_allclose(mirrored(scan).points_m[::-1], scan.points_m * [1, -1], atol=1e-5)
