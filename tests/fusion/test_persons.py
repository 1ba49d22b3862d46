from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fusion_scene import CAMERA, Person, Scan, boxes_of, robot
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from semap_ingest.fusion.persons import SensorGeometry, fuse
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.detections import BOTH, LASER, Detections
from semap_ingest.sensing.detections import CAMERA as BY_CAMERA

from semap.errors import InvalidInput


def seen(persons: list[Person], score: float = 0.8) -> tuple[Boxes, LegClusters, SensorGeometry]:
    """Both sensors see all of it, without noise."""
    geometry = robot()
    scan = Scan(geometry)
    for person in persons:
        scan.add(person.legs, score)
    return boxes_of(persons, geometry), scan.clusters(), geometry


def errors_m(found: Detections, persons: list[Person]) -> np.ndarray:
    return np.hypot(*(found.position_m - [person.place for person in persons]).T)


def test_a_person_seen_by_both_stands_between_the_legs() -> None:
    person = Person(4.0, 1.0, heading=0.5, stride=0.6)
    boxes, clusters, geometry = seen([person])
    found = fuse(boxes, clusters, geometry, 0)
    assert errors_m(found, [person])[0] < 0.05
    assert found.seen_by.tolist() == [BOTH]
    assert found.hint.tolist() == [7]
    assert found.score[0] > 0.95
    assert np.isnan(found.extent_m).all()
    assert np.sqrt(np.linalg.eigvalsh(found.covariance_m2[0])).max() < 0.1


def test_places_are_without_bias_and_covariances_honest() -> None:
    """Normalised squared errors of 2 degrees of freedom: 2 in the mean if the covariance is exact; 5.99 is 95 %."""
    generator = np.random.default_rng(3)
    geometry = robot()
    squared, offsets = [], []
    for _ in range(300):
        away, azimuth = generator.uniform(2, 8), generator.uniform(-0.6, 0.6)
        person = Person(
            away * np.cos(azimuth),
            away * np.sin(azimuth),
            heading=generator.uniform(-np.pi, np.pi),
            stride=generator.uniform(-1, 1),
            height=generator.normal(1.7, 0.1),
        )
        # Legs swing beside the middle of the body: measured on walks, some 7 cm along the way.
        sway = generator.normal(0, 0.07) * np.array([np.cos(person.heading), np.sin(person.heading)])
        legs = person.legs[generator.permutation(2)[: generator.integers(1, 3)]] + sway
        scan = Scan(geometry).add(legs, 0.7)
        found = fuse(boxes_of([person], geometry, generator), scan.clusters(generator), geometry, 0)
        offset = found.position_m[0] - person.place
        offsets.append(offset)
        squared.append(offset @ np.linalg.solve(found.covariance_m2[0], offset))
    assert np.abs(np.mean(offsets, axis=0)).max() < 0.02
    assert 0.8 < np.mean(squared) < 2.2
    assert np.mean(np.array(squared) < 5.99) > 0.93


@pytest.mark.parametrize("score", [0.2, 0.5, 0.9])
def test_a_weak_cluster_is_a_leg_where_a_box_asks_for_it(score: float) -> None:
    person = Person(4.0, -0.5)
    boxes, clusters, geometry = seen([person], score)
    found = fuse(boxes, clusters, geometry, 0)
    assert found.seen_by.tolist() == [BOTH]
    assert errors_m(found, [person])[0] < 0.05


def test_more_evidence_makes_a_person_more_credible() -> None:
    person = Person(4.0, 0.0)
    boxes, clusters, geometry = seen([person])
    one_leg = Scan(geometry).add(person.legs[:1], 0.8).clusters()
    none = Scan(geometry).clusters()
    both, single, hidden, unknown = (
        fuse(boxes, legs, geometry, 0) for legs in (clusters, one_leg, none, None)
    )
    assert both.score[0] > single.score[0] > unknown.score[0] > hidden.score[0]
    assert unknown.score[0] == pytest.approx(0.9)
    traces = [np.trace(each.covariance_m2[0]) for each in (both, single, hidden, unknown)]
    assert traces[0] < traces[1] < traces[2] == traces[3]
    assert [each.seen_by[0] for each in (both, single, hidden, unknown)] == [BOTH, BOTH, BY_CAMERA, BY_CAMERA]


@pytest.mark.parametrize("apart", [0.55, 0.7, 1.0])
@pytest.mark.parametrize("away", [2.5, 4.0, 6.0])
def test_two_side_by_side_keep_their_own_legs(apart: float, away: float) -> None:
    persons = [Person(away, apart / 2, heading=np.pi), Person(away, -apart / 2, heading=np.pi)]
    found = fuse(*seen(persons), 0)
    assert found.seen_by.tolist() == [BOTH, BOTH]
    assert errors_m(found, persons).max() < 0.1


@pytest.mark.parametrize("gap", [0.7, 1.0, 2.0])
@pytest.mark.parametrize("aside", [0.0, 0.2])
def test_one_behind_the_other_keep_their_own_legs(gap: float, aside: float) -> None:
    persons = [Person(3.0, 0.0, stride=0.3), Person(3.0 + gap, aside, heading=np.pi)]
    found = fuse(*seen(persons), 0)
    assert found.seen_by.tolist() == [BOTH, BOTH]
    assert errors_m(found, persons).max() < 0.15


def test_who_has_one_leg_in_sight_does_not_take_the_neighbours() -> None:
    persons = [Person(4.0, 0.3, heading=np.pi), Person(4.0, -0.3, heading=np.pi)]
    geometry = robot()
    scan = Scan(geometry).add(persons[0].legs[:1], 0.8).add(persons[1].legs, 0.8)
    found = fuse(boxes_of(persons, geometry), scan.clusters(), geometry, 0)
    assert len(found) == 2
    assert errors_m(found, persons).max() < 0.2


def test_of_many_persons_all_legs_go_to_their_owners() -> None:
    generator = np.random.default_rng(4)
    persons: list[Person] = []
    while len(persons) < 12:
        away, azimuth = generator.uniform(2, 8), generator.uniform(-0.6, 0.6)
        person = Person(
            away * np.cos(azimuth), away * np.sin(azimuth), generator.uniform(-3, 3), generator.uniform(-1, 1)
        )
        if all(np.hypot(*(person.place - other.place)) > 0.9 for other in persons):
            persons.append(person)
    found = fuse(*seen(persons), 0)
    assert found.seen_by.tolist() == [BOTH] * 12
    assert errors_m(found, persons).max() < 0.1


def test_the_order_of_boxes_and_clusters_does_not_matter() -> None:
    persons = [Person(4.0, 0.3), Person(4.3, -0.2, stride=1.0), Person(3.0, 1.0)]
    boxes, clusters, geometry = seen(persons)
    found = fuse(boxes, clusters, geometry, 0)
    back = np.arange(3)[::-1]
    turned = replace(
        boxes, corners_px=boxes.corners_px[back], score=boxes.score[back], track=boxes.track[back]
    )
    order = np.array([3, 5, 0, 2, 4, 1])
    mixed = replace(
        clusters,
        centre_m=clusters.centre_m[order],
        covariance_m2=clusters.covariance_m2[order],
        score=clusters.score[order],
    )
    again = fuse(turned, mixed, geometry, 0)
    assert np.allclose(again.position_m[back], found.position_m)
    assert again.hint[back].tolist() == found.hint.tolist()


def test_legs_in_no_box_are_a_person_by_laser_and_less_credible_in_view() -> None:
    behind, in_view = Person(-3.0, 0.5), Person(3.0, 0.5)
    geometry = robot()
    scan = Scan(geometry).add(behind.legs, 0.8).add(in_view.legs, 0.8)
    with_camera = fuse(boxes_of([], geometry), scan.clusters(), geometry, 0)
    alone = fuse(None, scan.clusters(), geometry, 0)
    for found in (with_camera, alone):
        assert found.seen_by.tolist() == [LASER, LASER]
        assert errors_m(found, [behind, in_view]).max() < 0.02
        assert found.hint.tolist() == [-1, -1]
        assert np.sqrt(np.linalg.eigvalsh(found.covariance_m2)).min() > 0.09
    assert alone.score[0] == alone.score[1] == with_camera.score[0] > 0.8
    assert with_camera.score[1] < 0.7


def test_a_person_hidden_by_a_nearer_one_is_not_held_against_the_laser() -> None:
    near, far = Person(2.0, 0.0), Person(5.0, 0.1)
    geometry = robot()
    scan = Scan(geometry).add(near.legs, 0.8).add(far.legs, 0.8)
    found = fuse(boxes_of([near], geometry), scan.clusters(), geometry, 0)
    in_full_view = fuse(boxes_of([], geometry), Scan(geometry).add(far.legs, 0.8).clusters(), geometry, 0)
    assert found.seen_by.tolist() == [BOTH, LASER]
    assert errors_m(found, [near, far]).max() < 0.1
    assert found.score[1] > in_full_view.score[0] + 0.1


def test_a_third_cluster_at_the_legs_is_no_other_person() -> None:
    person = Person(4.0, 0.0)
    geometry = robot()
    scan = Scan(geometry).add(person.legs, 0.9).add(person.place + np.array([0.05, 0.0]), 0.9)
    found = fuse(boxes_of([person], geometry), scan.clusters(), geometry, 0)
    assert len(found) == 1


def test_clutter_far_from_the_body_of_a_box_is_not_its_leg() -> None:
    person = Person(3.0, 0.0)
    geometry = robot()
    wall_behind = Scan(geometry).add(np.array([[6.0, 0.0], [6.0, 0.3]]), 0.4)
    found = fuse(boxes_of([person], geometry), wall_behind.clusters(), geometry, 0)
    assert found.seen_by.tolist() == [BY_CAMERA, LASER]
    assert found.score[1] < 0.5


def test_what_is_older_is_less_certain() -> None:
    boxes, clusters, geometry = seen([Person(4.0, 0.0)])
    now, later = fuse(boxes, clusters, geometry, 0), fuse(boxes, clusters, geometry, 100_000)
    assert np.trace(later.covariance_m2[0]) > np.trace(now.covariance_m2[0])
    assert later.stamp_us == 100_000


def test_nothing_seen_is_nobody_there() -> None:
    geometry = robot()
    nobody = boxes_of([], geometry)
    no_legs = Scan(geometry).clusters()
    for boxes in (None, nobody):
        for clusters in (None, no_legs):
            found = fuse(boxes, clusters, geometry, 5, frame="floor")
            assert (len(found), found.stamp_us, found.frame) == (0, 5, "floor")
            assert found.covariance_m2.shape == (0, 2, 2)
            assert found.extent_m.shape == (0, 2)


def test_what_has_no_place_in_the_map_is_left_out() -> None:
    boxes, clusters, geometry = seen([Person(4.0, 0.0)])
    assert fuse(boxes, clusters, replace(geometry, map_T_laser=None), 0).seen_by.tolist() == [BY_CAMERA]
    for without in (replace(geometry, camera=None), replace(geometry, map_T_camera=None)):
        assert fuse(boxes, clusters, without, 0).seen_by.tolist() == [LASER]
    assert len(fuse(boxes, clusters, SensorGeometry(None, None, None), 0)) == 0


def test_only_boxes_of_persons_count() -> None:
    boxes, _, geometry = seen([Person(4.0, 0.0), Person(3.0, 1.0)])
    mixed = replace(boxes, label=("chair", "person"))
    assert fuse(mixed, None, geometry, 0).hint.tolist() == [8]
    assert fuse(mixed, None, geometry, 0, labels={"chair"}).hint.tolist() == [7]


NUMBERS = st.floats(allow_nan=True, allow_infinity=True, width=32) | st.floats(-20, 20)


@settings(max_examples=60, deadline=None, phases=[Phase.generate])
@given(
    st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS), max_size=4),
    st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=6),
)
def test_whatever_is_given_what_comes_out_are_numbers(
    corners: list[tuple[float, ...]], legs: list[tuple[float, ...]]
) -> None:
    table, spots = np.array(corners).reshape(-1, 5), np.array(legs).reshape(-1, 3)
    boxes = Boxes(0, "c", table[:, :4], table[:, 4], ("person",) * len(table), np.full(len(table), -1))
    clusters = LegClusters(
        0,
        "laser",
        spots[:, :2],
        np.tile(1e-4 * np.eye(2), (len(spots), 1, 1)),
        spots[:, 2],
        np.full(len(spots), 0.1),
        np.full(len(spots), 5),
    )
    found = fuse(boxes, clusters, robot(), 0)
    assert np.isfinite(found.position_m).all()
    assert (np.linalg.eigvalsh(found.covariance_m2) > 0).all()
    assert ((found.score >= 0) & (found.score <= 1)).all()
    assert len(found.seen_by) == len(found.hint) == len(found.extent_m) == len(found)


def test_a_crowd_beyond_all_measure_is_fused_all_the_same() -> None:
    generator = np.random.default_rng(5)
    geometry = robot()
    scan = Scan(geometry).add(generator.uniform([1, -4], [6, 4], (3000, 2)), 0.4)
    low = generator.uniform(0, [600, 200], (200, 2))
    corners = np.hstack([low, low + generator.uniform([20, 60], [200, 270], (200, 2))])
    boxes = Boxes(0, "c", corners, np.full(200, 0.9), ("person",) * 200, np.arange(200))
    found = fuse(boxes, scan.clusters(), geometry, 0)
    assert (found.seen_by != LASER).sum() == 200
    assert (found.seen_by == BOTH).sum() > 30
    assert np.isfinite(found.covariance_m2).all()


def test_a_broken_camera_is_an_error_that_says_so() -> None:
    boxes, clusters, geometry = seen([Person(4.0, 0.0)])
    broken = replace(geometry, camera=replace(CAMERA, matrix=np.zeros((3, 3))))
    with pytest.raises(InvalidInput, match="camera"):
        fuse(boxes, clusters, broken, 0)
