import dataclasses
import math
from pathlib import Path

import numpy as np
import onnx
import pytest
from data_sets import data_set
from laser.leg_scene import cast, scan_of
from onnx import TensorProto, helper
from semap_ingest.laser.clusters import find_clusters
from semap_ingest.laser.detector import LegDetector
from semap_ingest.laser.features import FEATURES
from semap_ingest.laser.pairing import pair_legs
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.scan import Scan

from semap.errors import InvalidInput

BAGS = "laser_people/training_scans_res_0.33"


@pytest.fixture(scope="module")
def detector() -> LegDetector:
    return LegDetector.open()


def test_two_legs_before_a_wall_are_one_person(detector: LegDetector) -> None:
    legs = np.array([[2.0, -0.15], [2.1, 0.15]])
    found = detector.detect(cast(legs, 0.07, wall_m=4.0, noise_m=0.01, rng=np.random.default_rng(0)))
    nearest = [int(np.argmin(np.hypot(*(found.centre_m - leg).T))) for leg in legs]
    np.testing.assert_allclose(found.centre_m[nearest], legs, atol=0.03)
    assert (found.score[nearest] > 0.5).all()
    persons = pair_legs(found, np.ones(len(found), bool))
    assert sorted(nearest) in persons.tolist()
    assert (found.score[found.width_m > 1.0] < 0.5).all()


def test_values_agree_with_the_clusters(detector: LegDetector) -> None:
    scan = dataclasses.replace(cast(np.array([[2.0, 0.0]]), wall_m=3.0), stamp_us=17, frame="front")
    found, clusters = detector.detect(scan), find_clusters(scan)
    assert (found.stamp_us, found.frame, len(found)) == (17, "front", len(clusters))
    np.testing.assert_array_equal(found.points, clusters.count)
    assert found.covariance_m2.shape == (len(found), 2, 2)


@pytest.mark.parametrize(
    "scan",
    [
        scan_of([]),
        scan_of([1.0]),
        scan_of([math.nan] * 811),
        scan_of([math.inf] * 811),
        scan_of([-1.0] * 811),
        scan_of([1.0] * 811, 0.0),
        scan_of([1.0] * 811, math.nan),
        scan_of([1.0] * 811, first_rad=math.inf),
        scan_of([1.0, math.nan, 0.0, math.inf, 2.0] * 100),
        Scan(0, "laser", -2.0, -0.005, 0.0, math.inf, np.array([0.0, 1.0, 1.0, 1.0, math.inf], np.float32)),
        Scan(0, "laser", 0.0, 0.1, math.nan, math.nan, np.ones(20, np.float32)),
    ],
)
def test_hostile_scans_give_finite_clusters_or_none(detector: LegDetector, scan: Scan) -> None:
    found = detector.detect(scan)
    assert np.isfinite(found.centre_m).all()
    assert np.isfinite(found.covariance_m2).all()
    assert ((found.score >= 0) & (found.score <= 1)).all()
    assert len({len(found.centre_m), len(found.covariance_m2), len(found.score), len(found.points)}) == 1


def test_a_mirrored_scan_gives_mirrored_axes(detector: LegDetector) -> None:
    legs = np.array([[1.5, 0.4], [2.5, -0.8]])
    scan = cast(legs, 0.06, wall_m=6.0)
    mirrored = dataclasses.replace(scan, angle_min_rad=-scan.angles_rad[-1], ranges_m=scan.ranges_m[::-1])
    plain, turned = detector.detect(scan), detector.detect(mirrored)
    np.testing.assert_allclose(plain.centre_m, turned.centre_m[::-1] * [1, -1], atol=1e-5)


def test_marked_legs_of_the_bags_are_found_again(detector: LegDetector) -> None:
    """The shipped forest has learnt from these bags: this shows that it is the forest, not that it generalises."""
    found, others = [], []
    for name in ("positive_1", "positive_4", "positive_6"):
        with Recording(data_set(f"{BAGS}/{name}_extracted.bag")) as bag:
            records = [each.value for each in bag.records()][:160]
        for marks, scan in zip(records[::2], records[1::2], strict=True):
            legs = detector.detect(scan)
            clusters = find_clusters(scan)
            middle = clusters.mean(clusters.points_m[clusters.member])
            apart = np.hypot(*(middle[:, None] - marks.position_m[None, :, :2]).transpose(2, 0, 1)).min(
                axis=1
            )
            found.append(legs.score[apart < 0.01] >= 0.5)
            others.append(legs.score[apart > 1.0] < 0.5)
    sensitivity, specificity = np.concatenate(found).mean(), np.concatenate(others).mean()
    assert (sensitivity + specificity) / 2 > 0.93


def test_somebody_walks_through_another_place(detector: LegDetector) -> None:
    """A laser and a room that the forest has not learnt from: in most scans there is a person, and never a crowd."""
    with Recording(data_set("laser_people/demo_stationary_simple_environment.bag")) as bag:
        scans = [each.value for each in bag.records() if isinstance(each.value, Scan)][::25]
    persons = [len(pair_legs(legs, np.ones(len(legs), bool))) for legs in map(detector.detect, scans)]
    assert np.mean(np.array(persons) > 0) > 0.8
    assert max(persons) < 8


def test_a_model_of_other_features_is_refused(tmp_path: Path) -> None:
    graph = helper.make_graph(
        [helper.make_node("Identity", ["x"], ["probabilities"])],
        "other",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [None, 4])],
        [helper.make_tensor_value_info("probabilities", TensorProto.FLOAT, [None, 4])],
    )
    path = tmp_path / "other.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 15)], ir_version=8), path)
    with pytest.raises(InvalidInput, match="not a classifier of the 37 features") as refused:
        LegDetector.open(path)
    assert "legs.py" in refused.value.remedy


def test_the_shipped_model_knows_its_features(detector: LegDetector) -> None:
    assert detector.model.metadata["features"].split() == list(FEATURES)


def test_there_is_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no file"):
        LegDetector.open(tmp_path / "none.onnx")
