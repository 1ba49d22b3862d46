from __future__ import annotations

import numpy as np
import pytest
from fusion_scene import CAMERA, Person, box_of, boxes_of, pose, robot
from semap_ingest.fusion.body_from_box import place
from semap_ingest.fusion.sensor_geometry import SensorGeometry, View, view_of


def view(geometry: SensorGeometry | None = None) -> View:
    found = view_of(geometry or robot())
    assert found is not None
    return found


def at(range_m: float, azimuth: float, **more: float) -> Person:
    return Person(range_m * np.cos(azimuth), range_m * np.sin(azimuth), **more)


def normalised(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    return np.array([e @ np.linalg.solve(c, e) for e, c in zip(errors, covariances, strict=True)])


def test_bodies_of_boxes_have_little_bias_and_an_honest_covariance() -> None:
    generator = np.random.default_rng(1)
    persons = [
        at(
            generator.uniform(1.8, 9),
            generator.uniform(-0.6, 0.6),
            heading=generator.uniform(-np.pi, np.pi),
            stride=generator.uniform(-1, 1) * generator.integers(0, 2),
            height=generator.normal(1.7, 0.12),
        )
        for _ in range(400)
    ]
    boxes = np.concatenate([boxes_of([person], robot(), generator).corners_px for person in persons])
    # One box at a time: those of different persons must not cover one another here.
    bodies = [place(box[None], view()) for box in boxes]
    position = np.concatenate([each.position_m for each in bodies])
    covariance = np.concatenate([each.covariance_m2 for each in bodies])
    truth = np.array([person.place for person in persons])
    away = np.hypot(*truth.T)
    towards = truth / away[:, None]
    along = ((position - truth) * towards).sum(axis=1)
    across = (position - truth)[:, 1] * towards[:, 0] - (position - truth)[:, 0] * towards[:, 1]
    for nearest, farthest in ((1.8, 4), (4, 6), (6, 9)):
        here = (away >= nearest) & (away < farthest)
        assert abs(along[here].mean()) < 0.12
        assert abs(across[here].mean()) < 0.02
        assert along[here].std() < 0.035 * farthest + 0.15
    squared = normalised(position - truth, covariance)
    assert 0.4 < squared.mean() < 2
    assert (squared < 5.99).mean() > 0.95


@pytest.mark.parametrize("yaw", [0.0, 2.0, -3.0])
def test_a_place_does_not_depend_on_where_the_robot_stands(yaw: float) -> None:
    still, moved = robot(), robot(5, -3, yaw)
    person = Person(4.0, 0.7, heading=1.0)
    transform = pose(5, -3, 0, yaw)
    elsewhere = Person(*(transform[:2, :2] @ person.place + transform[:2, 3]), heading=1.0 + yaw)
    first = place(box_of(person, still)[None], view(still))
    second = place(box_of(elsewhere, moved)[None], view(moved))
    assert np.allclose(second.position_m, first.position_m @ transform[:2, :2].T + transform[:2, 3])
    assert np.allclose(second.covariance_m2, transform[:2, :2] @ first.covariance_m2 @ transform[:2, :2].T)


@pytest.mark.parametrize("range_m", [1.0, 1.3, 1.5])
def test_feet_below_the_image_are_not_taken_for_the_bottom(range_m: float) -> None:
    box = boxes_of([at(range_m, 0.1)], robot()).corners_px
    assert box[0, 3] == 479
    body = place(box, view())
    error = body.position_m - at(range_m, 0.1).place
    assert np.hypot(*error[0]) < 0.5
    assert normalised(error, body.covariance_m2)[0] < 5.99


@pytest.mark.parametrize("azimuth", [0.72, -0.72])
def test_half_a_body_at_the_side_of_the_image_is_not_its_middle(azimuth: float) -> None:
    person = at(3.0, azimuth)
    box = boxes_of([person], robot()).corners_px
    body = place(box, view())
    error = body.position_m - person.place
    assert np.hypot(*error[0]) < 0.35
    assert normalised(error, body.covariance_m2)[0] < 5.99


def test_feet_that_a_nearer_person_hides_make_the_range_uncertain_and_not_wrong() -> None:
    near, far = at(2.5, 0.0), at(5.0, 0.03)
    boxes = boxes_of([near, far], robot()).corners_px
    whole = place(boxes[1:], view()).covariance_m2
    boxes[1, 3] -= 0.3 * (boxes[1, 3] - boxes[1, 1])
    body = place(boxes, view())
    error = (body.position_m - [near.place, far.place])[1:]
    assert np.trace(body.covariance_m2[1]) > 1.5 * np.trace(whole[0])
    assert normalised(error, body.covariance_m2[1:])[0] < 5.99


def test_a_body_behind_a_desk_is_as_far_as_its_head_says() -> None:
    person = at(3.0, 0.0)
    box = box_of(person, robot())
    box[3] = 250.0
    body = place(box[None], view())
    assert np.hypot(*(body.position_m[0] - person.place)) < 0.7


def test_a_box_that_fills_the_image_is_near() -> None:
    body = place(np.array([[0.0, 0.0, 639.0, 479.0], [200.0, 0.0, 500.0, 479.0]]), view())
    assert (body.range_m < 1).all()
    assert np.isfinite(body.covariance_m2).all()


def test_any_box_has_a_place_or_none_and_a_covariance_that_is_one() -> None:
    generator = np.random.default_rng(2)
    low, high = generator.uniform(0, 470, (500, 2)), generator.uniform(1, 170, (500, 2))
    boxes = np.hstack([low, np.minimum(low + high, [639, 479])])
    body = place(boxes, view())
    assert np.isfinite(body.position_m).all()
    assert (np.linalg.eigvalsh(body.covariance_m2) > 0).all()
    assert ((body.range_m > 0.25) & (body.range_m < 41)).all()


def test_a_camera_as_high_as_heads_tells_ranges_by_feet_and_width() -> None:
    high = SensorGeometry(CAMERA, pose(0, 0, 1.7, 0, optical=True), None)
    person = Person(4.0, 0.0)
    body = place(box_of(person, high)[None], view(high))
    assert np.hypot(*(body.position_m[0] - person.place)) < 0.4


@pytest.mark.parametrize("camera_z_m", [0.0, -0.5])
def test_a_camera_whose_height_is_not_told_goes_by_head_and_shoulders(camera_z_m: float) -> None:
    """Seen from the floor or from below it: where the feet stand follows from nothing."""
    geometry = SensorGeometry(CAMERA, pose(0, 0, camera_z_m, 0, optical=True), None)
    box = np.array([[290.0, 100.0, 350.0, 300.0]])
    bodies = place(box, view(geometry))
    assert np.isfinite(bodies.position_m).all()
    assert (np.linalg.eigvalsh(bodies.covariance_m2) > 0).all()
    lower = place(box + np.array([0.0, 0, 0, 60]), view(geometry))
    np.testing.assert_allclose(lower.position_m, bodies.position_m, atol=0.02)
