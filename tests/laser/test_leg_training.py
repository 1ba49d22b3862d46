"""What the leg classifier is trained with; on a slice of the bags and a few made-up places, with few trees."""

import math
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from data_sets import data_set
from laser.leg_scene import cast
from sklearn.metrics import roc_auc_score

from ingest.training.leg_laser import NOBODY, Laser, seen
from ingest.training.leg_samples import (
    BAGS,
    LEG,
    OTHER,
    Samples,
    made_up,
    marked_beams,
    mirrored,
    read_samples,
    still_share,
)
from ingest.training.leg_world import Scene, World, passer_by
from ingest.training.legs import MADE_UP, Boosting, cross_validate, export, joined, table, train

SMALL = Boosting(trees=20, leaves=8)


@pytest.fixture(scope="module")
def samples() -> dict[str, Samples]:
    folder = data_set("laser_people")
    chosen = [bag for bag in BAGS if bag.name in ("positive_2", "positive_6", "negative_2")]
    return {bag.name: read_samples(folder, bag, every=4) for bag in chosen} | {MADE_UP: made_up(range(40))}


def test_marks_become_labels_of_the_cluster_that_they_are_the_middle_of(samples: dict[str, Samples]) -> None:
    for name in ("positive_2", "positive_6"):
        judged = samples[name][samples[name].is_judged]
        assert (judged.label == LEG).sum() > 5
    empty = samples["negative_2"]
    assert set(empty.label[empty.is_judged].tolist()) == {OTHER}
    assert (empty.label == LEG).any()  # the people who were put there


def test_a_classifier_of_one_place_knows_legs_of_another(samples: dict[str, Samples]) -> None:
    judged = list(cross_validate(samples, [["positive_2"], ["positive_6"]], SMALL))
    assert all(roc_auc_score(each.is_leg, each.score) > 0.7 for _, each in judged)
    assert [row.split("|")[1].strip() for row in table(judged).splitlines()[2:]] == [
        "positive_2",
        "positive_6",
    ]


def test_the_file_is_the_classifier_and_the_same_each_time(tmp_path: Path) -> None:
    learnt = {MADE_UP: made_up(range(20))}
    classifier = train(learnt, SMALL)
    export(classifier, tmp_path / "one.onnx")
    export(train(learnt, SMALL), tmp_path / "other.onnx")
    assert (tmp_path / "one.onnx").read_bytes() == (tmp_path / "other.onnx").read_bytes()
    session = onnxruntime.InferenceSession(tmp_path / "one.onnx", providers=["CPUExecutionProvider"])
    features = joined(list(learnt.values())).features
    (scores,) = session.run(["probabilities"], {"features": features})
    np.testing.assert_allclose(scores, classifier.predict_proba(features), atol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_a_made_up_person_is_met_where_it_stands(seed: int) -> None:
    """Each beam that is said to meet the person ends within its legs' reach, every other one at the wall."""
    random = np.random.default_rng(seed)
    person, row = passer_by(np.array([2.0, 0.5]), 0.3, random)
    wall = np.array([[[5.0, -20.0], [5.0, 20.0]]])
    place = Scene(World(wall, np.zeros((0, 3)), (40.0, 40.0), 0.3), (person,), 1.0)
    exact = Laser(math.radians(0.25), math.radians(90), 30.0, 10.0, 0.0, 0.0, 1e-6, 0.0, 0.0)
    scan, whom = seen(place, exact, (0.0, 0.0, 0.0), row, random)
    away = np.hypot(*(scan.points_m[:, None] - person.legs_m[row]).transpose(2, 0, 1)).min(axis=1)
    is_met = whom != NOBODY
    assert is_met.sum() > 3
    assert (away[is_met] <= person.axes_m.max() + 4 * person.cloth_m + 1e-4).all()
    np.testing.assert_allclose(scan.points_m[~is_met, 0], 5.0, atol=1e-4)


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
