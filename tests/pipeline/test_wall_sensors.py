"""The simulated office with cameras on its walls: who is seen by several is one, and enters a room once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from semap_ingest.fusion.body_from_box import place
from semap_ingest.fusion.sensor_geometry import View
from semap_ingest.pipeline.ingest_recording import Plan, ingest_recording
from semap_ingest.simulation.floor import office_floor
from semap_ingest.simulation.labels import Labels, read_labels
from semap_ingest.simulation.office import OfficePaths, write_office
from semap_ingest.simulation.schedule import moments
from semap_ingest.simulation.settings import OfficeSettings
from semap_ingest.simulation.wall_sensors import CAMERAS, true_boxes
from semap_service.evaluation.tracking import perceive, score_crowd, told_at
from semap_service.evaluation.walls import BOXES, WITHIN_US, doubled

from semap.errors import InvalidInput
from semap.store.database.connection import connect

SETTINGS = OfficeSettings(seed=1, people=4, duration_s=30.0, camera=False, wall_cameras=4)


@pytest.fixture(scope="module")
def walls(tmp_path_factory: pytest.TempPathFactory) -> OfficePaths:
    return write_office(tmp_path_factory.mktemp("walls") / "office", SETTINGS)


@pytest.fixture(scope="module")
def labels(walls: OfficePaths) -> Labels:
    return read_labels(walls.labels)


def plan(path: Path, boxes: Sequence[str], scan: Sequence[str] = ()) -> Plan:
    return Plan("office", "walls", path, topics={"scan": scan, "boxes": boxes})


def test_four_cameras_follow_people_better_than_the_best_of_them(walls: OfficePaths, labels: Labels) -> None:
    seen_by_cameras = replace(labels.tracks, laser_beams=np.zeros_like(labels.tracks.laser_beams))
    together = score_crowd(plan(walls.recording, BOXES), seen_by_cameras, WITHIN_US)
    alone = [score_crowd(plan(walls.recording, [each]), seen_by_cameras, WITHIN_US) for each in BOXES]
    assert together.idf1 > max(each.idf1 for each in alone)
    assert together.mota > max(each.mota for each in alone) + 0.1


@pytest.mark.parametrize("scan", [(), ("/scan",)], ids=["cameras", "cameras and a laser"])
def test_who_is_in_several_views_is_one_track(
    walls: OfficePaths, labels: Labels, scan: Sequence[str]
) -> None:
    states = list(perceive(plan(walls.recording, BOXES, scan)))
    assert doubled(labels.tracks, told_at(labels.tracks, states, WITHIN_US)) < 0.01


def test_a_person_who_enters_a_room_is_told_once(office_map: str, walls: OfficePaths, labels: Labels) -> None:
    with connect(office_map) as connection:
        # whoever crosses a border sways over it by centimetres: the margins of --debounce
        connection.execute("update semap.continuous_query set enter_margin_m = 0.15, leave_margin_m = 0.15")
        connection.commit()
    ingest_recording(office_map, plan(walls.recording, BOXES, ["/scan"]))
    with connect(office_map) as connection:
        told = connection.execute(
            "select instance_name, track_name, stamp::text from semap.relation_change where query_name ="
            " 'track_in_room' and kind = 'began' and cause = 'moved' and instance_name <> 'Hallway' order by stamp"
        ).fetchall()
    entered = Counter(each.room for each in labels.transitions if each.kind == "entered")
    assert entered.total() == 3
    assert Counter(room for room, _, _ in told) == entered, told


def test_overlapping_views_see_one_person_at_one_place() -> None:
    course = moments(SETTINGS)
    seen = np.array(
        [
            [
                np.isfinite(true_boxes(camera, office_floor(), course.at(time_s))).all(axis=1)
                for camera in CAMERAS[:4]
            ]
            for time_s in np.arange(0.0, 30.0, 0.5)
        ]
    )
    assert (seen.sum(axis=1) >= 2).mean() > 0.1, "the test would prove nothing"


def test_a_position_from_a_box_is_as_far_off_as_it_says() -> None:
    """Normalised errors squared of boxes with a detector's errors: two on the mean where a position is honest."""
    course, dice, squares = moments(SETTINGS), np.random.default_rng(1), []
    for time_s in np.arange(0.0, 30.0, 0.25):
        moment = course.at(float(time_s))
        truth_m = np.array([body.position_m for body in moment.bodies])
        for eye in CAMERAS[:4]:
            boxes = true_boxes(eye, office_floor(), moment)
            is_seen = np.isfinite(boxes).all(axis=1)
            if not is_seen.any():
                continue
            boxes = boxes[is_seen]
            boxes += dice.normal(0, 1, boxes.shape) * (1 + 0.02 * np.tile(boxes[:, 2:] - boxes[:, :2], 2))
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = eye.turn.as_matrix(), eye.place[:3]
            told = place(boxes, View(eye.camera, pose, 0.0))
            off_m = truth_m[is_seen] - told.position_m
            squares += np.einsum("ni,nij,nj->n", off_m, np.linalg.inv(told.covariance_m2), off_m).tolist()
    assert len(squares) > 200
    assert 0.5 < np.mean(squares) < 2.5
    assert np.mean(np.array(squares) > 13.8) < 0.01


@pytest.mark.parametrize("wrong", [{"wall_cameras": 7}, {"wall_lasers": -1}])
def test_sensors_that_no_wall_has_are_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(InvalidInput, match="on walls"):
        OfficeSettings(**wrong)
