"""Boxes that come now and then, of one object each, from cameras whose views overlap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from semap_bridge.adapter import Batch
from semap_bridge.watching import Watching, read_camera_rig
from watched_rooms import EAST, SECOND_US, START_US, WEST, Eye

from semap.errors import InvalidInput


def watching(folder: Path, kept_s: float = 10.0) -> Watching:
    (folder / "rig.yaml").write_text("sensors:\n" + WEST.entry() + EAST.entry())
    return Watching(read_camera_rig(folder / "rig.yaml"), kept_s, "office", "house")


def at(time_s: float) -> int:
    return START_US + round(time_s * SECOND_US)


def told(batches: list[Batch]) -> list[tuple[str, int, float, float]]:
    """Track, stamp, x and y of each state."""
    return [
        (name.partition(" of ")[0], *row)
        for batch in batches
        if len(batch.states)
        for name, *row in zip(
            batch.states.names,
            batch.states.stamp_us.tolist(),
            batch.states.values["x_m"].tolist(),
            batch.states.values["y_m"].tolist(),
            strict=True,
        )
    ]


def refusals(batches: list[Batch]) -> list[str]:
    return [each.reason for batch in batches for each in batch.refused]


def test_one_person_in_two_views_is_one_track_where_he_is(tmp_path: Path) -> None:
    house, batches = watching(tmp_path), []
    for number, time_s in enumerate([0.0, 0.7, 1.1, 3.9, 4.3, 8.8]):
        place = (4.0 + 0.2 * time_s, 0.3)
        eye, known_as = (WEST, "w1") if number % 2 else (EAST, "e9")
        batches += house.take([eye.sees(place, time_s, known_as)], at(time_s))
        batches += house.take([], at(time_s + 1.2))
    found = told(batches)
    assert {name for name, *_ in found} == {"person 1"}
    assert len(found) == 5, "believed from the second look on, and told at each"
    for _, stamp_us, x_m, y_m in found:
        time_s = (stamp_us - START_US) / SECOND_US
        assert np.hypot(x_m - 4.0 - 0.2 * time_s, y_m - 0.3) < 0.5
    assert refusals(batches) == []


def test_who_is_not_named_stays_and_who_is_silent_for_long_leaves(tmp_path: Path) -> None:
    house, batches = watching(tmp_path, kept_s=6.0), []
    for time_s in (0.0, 1.0):
        batches += house.take([WEST.sees((5.0, 0.8), time_s, "calm")], at(time_s))
    for time_s in np.arange(1.5, 6.0, 0.5):
        batches += house.take([WEST.sees((5.0, -1.2), float(time_s), "busy")], at(time_s))
    assert [track for batch in batches for track, _ in batch.ended] == []
    assert {name for name, *_ in told(batches)} == {"person 1", "person 2"}
    batches = house.take([], at(9.0))
    assert [track.partition(" of ")[0] for batch in batches for track, _ in batch.ended] == ["person 1"]
    batches = house.take([], at(14.0))
    assert [track.partition(" of ")[0] for batch in batches for track, _ in batch.ended] == ["person 2"]


def test_rules_need_not_wait_for_cameras_that_have_nothing_to_say(tmp_path: Path) -> None:
    house = watching(tmp_path)
    marks = [batch.watermark_us for batch in house.take([], at(5.0))]
    assert max(each for each in marks if each is not None) == at(4.0) - 1
    late = house.take([WEST.sees((5.0, 0.0), 3.0)], at(5.0))
    assert refusals([*late, *house.take([], at(6.0))]) == ["west: it came too late"]


def test_objects_of_one_picture_may_come_in_several_messages(tmp_path: Path) -> None:
    house, batches = watching(tmp_path), []
    for time_s in (0.0, 0.5, 1.0):
        batches += house.take([WEST.sees((4.5, 0.8), time_s, "a")], at(time_s))
        batches += house.take([WEST.sees((4.5, -0.8), time_s, "b")], at(time_s))
    batches += house.take([], at(3.0))
    assert {name for name, *_ in told(batches)} == {"person 1", "person 2"}
    assert refusals(batches) == []


def test_a_clock_that_is_far_ahead_makes_nobody_late(tmp_path: Path) -> None:
    house = watching(tmp_path)
    batches = house.take([EAST.sees((5.0, 0.0), 3600.0)], at(0.0))
    for time_s in (0.0, 0.5, 1.0):
        batches += house.take([WEST.sees((5.0, 0.0), time_s)], at(time_s))
    batches += house.take([], at(3.0))
    assert refusals(batches) == ["stamp ahead of this clock"]
    assert {name for name, *_ in told(batches)} == {"person 1"}


def test_a_camera_that_the_rig_does_not_have_is_refused(tmp_path: Path) -> None:
    batches = watching(tmp_path).take([Eye("attic", 0.0, 0.0).sees((5.0, 0.0), 0.0)], at(0.0))
    assert [(each.reason, each.detail) for batch in batches for each in batch.refused] == [
        ("the rig has no such camera", "attic")
    ]


@pytest.mark.parametrize(
    "entry",
    ["front: {kind: laser, topic: /scan}", "hall: {kind: camera, topic: hall}"],
)
def test_a_rig_without_the_place_of_a_camera_is_refused(entry: str, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(f"sensors:\n  {entry}\n")
    with pytest.raises(InvalidInput, match="is no fixed camera") as caught:
        read_camera_rig(path)
    assert "homography" in caught.value.remedy
