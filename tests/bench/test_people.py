"""What the benchmark of people before a laser compares: its truth, and whom it asks for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from data_sets import data_set
from semap_ingest.laser.detector import LegDetector
from semap_ingest.sensing.scan import Scan
from semap_service.evaluation.mot_scores import Places, mot_scores

from bench.people import measured
from bench.people_scenes import SCENES, Watched, of_bag, of_scenes, tracks_of
from ingest.training.leg_samples import BAGS
from ingest.training.legs import MADE_UP_SEEDS

ROOM = replace(SCENES[0], name="room", people=3, kind="furnished", length_s=12.0, seed=30_000)


def test_who_is_in_sight_of_a_made_up_place_is_met_by_beams() -> None:
    (watched,) = of_scenes([ROOM])
    scans = {each.value.stamp_us: each.value for each in watched.records if isinstance(each.value, Scan)}
    poses = {each.value.stamp_us: each.value for each in watched.records if not isinstance(each.value, Scan)}
    assert len(watched.truth) > 50
    for stamp_us, place_m in zip(watched.truth.stamp_us, watched.truth.position_m, strict=True):
        scan, pose = scans[int(stamp_us)], poses[int(stamp_us)]
        yaw_rad = 2 * np.arctan2(pose.quaternion[2], pose.quaternion[3])
        turn = np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])
        points_m = scan.points_m[scan.is_return] @ turn.T + pose.translation_m[:2]
        assert (np.hypot(*(points_m - place_m).T) < 0.5).sum() >= 3


def test_scenes_are_of_seeds_that_nothing_has_learnt_from() -> None:
    assert not {each.seed for each in SCENES} & {*MADE_UP_SEEDS}


def test_a_track_beside_somebody_out_of_sight_is_neither_right_nor_wrong() -> None:
    (watched,) = of_scenes([ROOM])
    legs = LegDetector.open()
    told = tracks_of(watched, legs)
    nobody = Places(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))
    places = np.column_stack([told.stamp_us.astype(np.float64), told.position_m])
    unasked = Watched("unasked", None, watched.records, nobody, places)
    assert len(told) > 0
    assert len(tracks_of(unasked, legs)) == 0


def test_what_moves_in_a_bag_is_one_person_who_is_followed() -> None:
    bag = next(each for each in BAGS if each.name == "positive_1")
    watched = of_bag(data_set("laser_people"), bag)
    assert set(watched.truth.identity.tolist()) == {0}
    assert (np.hypot(*np.diff(watched.truth.position_m, axis=0).T) < 0.6).mean() > 0.95
    scores = measured(watched, LegDetector.open())
    assert scores["recall"] > 0.6
    assert scores["precision"] > 0.6
    exact = mot_scores(watched.truth, watched.truth)
    assert (exact.mota, exact.idf1) == (1.0, 1.0)
