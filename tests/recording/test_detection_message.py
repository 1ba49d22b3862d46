"""Boxes and persons that somebody else has found."""

import math

import numpy as np
import pytest
from bags import Ros
from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.recording.detection_message import (
    decode_boxes,
    decode_persons,
    decode_uncertain_pose,
)
from semap_ingest.recording.passed_over import Flaw, Unusable
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.transform import PersonPoses
from shapely import Polygon
from shapely.affinity import rotate, translate

ROS = Ros(is_ros1=False)
PERSON = frozenset({"person"})


def boxes(*detections) -> Boxes:
    message = ROS.make(
        "vision_msgs/Detection2DArray", header=ROS.header(1_000, "camera"), detections=list(detections)
    )
    return decode_boxes(message, 0)


def persons(*detections) -> list[PersonPoses | Flaw]:
    message = ROS.make(
        "vision_msgs/Detection3DArray", header=ROS.header(1_000, "map"), detections=list(detections)
    )
    return list(decode_persons(message, 0, PERSON))


@given(st.floats(-500, 500), st.floats(-500, 500), st.floats(0, 300), st.floats(0, 300), st.floats(-7, 7))
def test_a_turned_box_gets_an_upright_one_around_it(
    x: float, y: float, width: float, height: float, theta: float
) -> None:
    found = boxes(ROS.box([], x, y, (width, height), theta)).corners_px[0]
    a, b = width / 2, height / 2
    turned = rotate(Polygon([(-a, -b), (a, -b), (a, b), (-a, b)]), theta, origin=(0, 0), use_radians=True)
    np.testing.assert_allclose(found, translate(turned, x, y).bounds, atol=1e-9)


def test_no_detections_and_none_that_are_finite() -> None:
    for found in (boxes(), boxes(ROS.box([], math.nan, 0, (1, 1)), ROS.box([], 0, 0, (math.inf, 1)))):
        assert found.corners_px.shape == (0, 4)
        assert found.score.shape == (0,)
        assert found.label == ()
        assert (found.track.shape, found.track.dtype) == ((0,), np.int64)
    (found,) = persons()
    assert (found.position_m.shape, found.covariance_m2.shape, found.score.shape) == ((0, 3), (0, 2, 2), (0,))


def test_the_likeliest_class_and_boxes_without_one() -> None:
    many = [ROS.hypothesis("dog", math.nan), ROS.hypothesis("person", 1.5), ROS.hypothesis("cat", -2)]
    found = boxes(ROS.box([], 0, 0, (1, 1)), ROS.box([], math.nan, 0, (1, 1)), ROS.box(many, 0, 0, (1, 1)))
    assert found.label == ("", "person")
    np.testing.assert_array_equal(found.score, [1, 1])


def test_a_box_of_negative_size_is_none() -> None:
    with pytest.raises(Unusable, match="a box of -1"):
        boxes(ROS.box([], 0, 0, (-1, 1)))


def test_a_person_s_place_is_the_middle_of_the_box_or_else_of_the_pose() -> None:
    told = [ROS.hypothesis("person", 0.5, (7, 8, 9))]
    (found,) = persons(
        ROS.solid(told, (1, 2, 3), (0.5, 0.5, 1.8)),
        ROS.solid(told, (0, 0, 0), (0, 0, 0)),
        ROS.solid([], (4, 5, 6), (0, 0, 0)),
        ROS.solid([], (math.inf, 5, 6), (1, 1, 1)),
    )
    np.testing.assert_array_equal(found.position_m, [[1, 2, 3], [7, 8, 9], [4, 5, 6]])
    np.testing.assert_array_equal(found.score, [0.5, 0.5, 1])
    assert np.isnan(found.covariance_m2).all()


@pytest.mark.parametrize(
    ("of_xy", "is_told"),
    [
        ([[0.2, 0.1], [0.1, 0.3]], True),
        ([[0, 0], [0, 0]], False),
        ([[-1, 0], [0, 0]], False),
        ([[1, 2], [2, 1]], False),
        ([[math.nan, 0], [0, 1]], False),
        ([[math.inf, 0], [0, 1]], False),
    ],
)
def test_a_covariance_that_is_none_is_not_told(of_xy: list[list[float]], is_told: bool) -> None:
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = of_xy
    message = ROS.make(
        "geometry_msgs/PoseWithCovarianceStamped",
        header=ROS.header(0, "map"),
        pose=ROS.uncertain((1, 2, 3), covariance.ravel()),
    )
    found = decode_uncertain_pose(message, 5)
    np.testing.assert_array_equal(found.covariance_m2, [of_xy if is_told else np.full((2, 2), np.nan)])
    assert found.stamp_us == 5
