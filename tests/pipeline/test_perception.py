"""Records in, results out: the same for the same, none behind a watermark, and nothing bad is fatal."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from semap_ingest.laser.detector import LegDetector
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.sensor import Sensor
from semap_ingest.recording.reading import Received, Recording
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import Camera, CompressedImage
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.transform import PersonPoses, Transform

SECOND_US = 1_000_000
PERIOD_US = 66_667
START_US = 1_767_604_500 * SECOND_US
# optical frame of a camera at 1.2 m that looks along x of the map
LOOKS_AHEAD = np.array([-0.5, 0.5, -0.5, 0.5])
CAMERA = Camera("optical", 640, 480, np.array([[320.0, 0, 320], [0, 320, 240], [0, 0, 1]]), np.zeros(5))
PEOPLE = Sensor("people", "finder", "/people")
EYE = Sensor("eye", "camera", "/boxes", period_us=30_000)


@pytest.fixture(scope="session")
def legs() -> LegDetector:
    return LegDetector.open()


@pytest.fixture(scope="session")
def records(plan) -> list[Received]:
    with Recording(plan.path) as recording:
        return list(recording.records())


def laser(legs: LegDetector, **more) -> Sensor:
    return Sensor("scan", "laser", "/scan", legs, period_us=60_000, **more)


def eye_and_laser(legs: LegDetector) -> list[Sensor]:
    """A camera that is fused with its laser."""
    return [laser(legs), replace(EYE, partner="scan")]


def still(child: str, place: tuple[float, float, float], turn=(0.0, 0.0, 0.0, 1.0)) -> Received:
    transform = Transform(START_US, "map", child, np.array(place), np.array(turn), is_static=True)
    return Received(START_US, "/tf_static", transform)


def boxes_at(stamp_us: int, label: str = "person") -> Boxes:
    corners = np.array([[300.0, 176.0, 340.0, 336.0]])
    return Boxes(stamp_us, "optical", corners, np.array([0.9]), (label,), np.array([-1]))


def poses_at(stamp_us: int, frame: str = "map", place=(3.0, 1.0, 0.0)) -> PersonPoses:
    unknown = np.full((1, 2, 2), np.nan)
    return PersonPoses(stamp_us, frame, np.array([place]), unknown, np.ones(1), ("",))


def play(perception: Perception, records: list[Received]) -> list[Found]:
    return [*(perception.take(each) for each in records), perception.flush()]


def said(found: list[Found]) -> list[tuple]:
    """Results to compare, bit by bit."""
    persons = [
        (
            each.sent_us,
            states.stamp_us,
            states.track.tolist(),
            states.position_m.tobytes(),
            states.covariance_m2.tobytes(),
            states.ended,
            states.amendments,
        )
        for one in found
        for each in one.persons
        for states in (each.states,)
    ]
    lines = [
        (each.sent_us, each.lines.stamp_us, each.lines.ends_m.tobytes(), each.z_m)
        for one in found
        for each in one.lines
    ]
    return [*persons, *lines, *((one.persons_watermark_us, one.lines_watermark_us) for one in found)]


def require_true_watermarks(found: list[Found]) -> None:
    persons_us = lines_us = -(1 << 62)
    for one in found:
        for each in one.persons:
            if len(each.states) or each.states.ended:
                assert each.states.stamp_us > persons_us
        for each in one.lines:
            assert each.lines.stamp_us > lines_us
        persons_us = max(persons_us, one.persons_watermark_us or persons_us)
        lines_us = max(lines_us, one.lines_watermark_us or lines_us)


def stamps_of_persons(found: list[Found]) -> list[int]:
    return [each.states.stamp_us for one in found for each in one.persons if len(each.states)]


def test_the_same_records_give_the_same(records, legs):
    first, second = (play(Perception([laser(legs)]), records) for _ in range(2))
    assert said(first) == said(second)
    require_true_watermarks(first)
    assert stamps_of_persons(first)
    ended = [track for one in first for each in one.persons for track, _ in each.states.ended]
    told = {int(track) for one in first for each in one.persons for track in each.states.track}
    assert sorted(ended) == sorted(told), "each track that was told ends once, and no other"


def with_boxes(records: list[Received], delays_us: list[int]) -> list[Received]:
    """A camera of the robot's own beside the laser: boxes 30 times a second, each sent later by its delay."""
    boxes = [
        Received(stamp_us + delay_us, "/boxes", boxes_at(stamp_us))
        for number, delay_us in enumerate(delays_us)
        for stamp_us in (START_US + number * SECOND_US // 30,)
    ]
    return sorted([*records, *boxes], key=lambda each: each.sent_us)


@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_no_result_is_behind_a_watermark_whatever_comes_when(records, legs, data):
    until_us = START_US + SECOND_US
    short = [each for each in records if each.sent_us < until_us]
    delays_us = data.draw(st.lists(st.integers(0, 400_000), min_size=30, max_size=30))
    lost = data.draw(st.sets(st.integers(0, len(short) - 1), max_size=20))
    kept = [each for place, each in enumerate(short) if place not in lost]
    perception = Perception(eye_and_laser(legs))
    perception.take(Received(START_US, "/camera_info", replace(CAMERA, frame="optical")))
    require_true_watermarks(play(perception, with_boxes(kept, delays_us)))


def test_a_clock_that_is_set_back_and_a_stamp_from_afar_are_left_out(records, legs):
    scans = [place for place, each in enumerate(records) if isinstance(each.value, Scan)]
    spoilt = list(records)
    for place, shift_us in ((scans[20], 3600 * SECOND_US), (scans[40], -2 * SECOND_US)):
        value = records[place].value
        spoilt[place] = replace(records[place], value=replace(value, stamp_us=value.stamp_us + shift_us))
    perception = Perception([laser(legs)])
    found = play(perception, spoilt)
    require_true_watermarks(found)
    assert perception.left_out == {
        "/scan: the stamp is far ahead of all others": 1,
        "/scan: the stamp is not after the one before": 1,
    }
    whole = stamps_of_persons(play(Perception([laser(legs)]), records))
    assert len(whole) - len(stamps_of_persons(found)) <= 2


@pytest.mark.parametrize("stamp_us", [-(10**16), 10**18])
def test_a_stamp_that_cannot_be_stored_is_left_out(stamp_us):
    perception = Perception([PEOPLE])
    found = play(perception, [Received(START_US, "/people", poses_at(stamp_us))])
    assert said(found) == said([Found(), Found()])
    assert perception.left_out == {"/people: the stamp is no time from 1800 to 9998": 1}


def test_event_time_that_goes_on_after_years_is_followed():
    stamps = [*range(0, 30 * PERIOD_US, PERIOD_US), *range(START_US, START_US + 30 * PERIOD_US, PERIOD_US)]
    perception = Perception([PEOPLE])
    found = play(perception, [Received(stamp_us, "/people", poses_at(stamp_us)) for stamp_us in stamps])
    require_true_watermarks(found)
    assert perception.left_out == {}
    assert max(stamps_of_persons(found)) == stamps[-1]
    assert len({int(t) for one in found for each in one.persons for t in each.states.track}) == 2


@pytest.mark.parametrize(
    "ranges", [[], [np.nan] * 811, [np.inf] * 811, [-1.0] * 811, [0.0] * 811, [1e38] * 811, [2.0]], ids=str
)
def test_scans_in_which_there_is_nothing_are_no_harm(legs, ranges):
    perception = Perception([laser(legs)])
    scans = [
        Scan(START_US + n * PERIOD_US, "laser", -2.35, 0.0058, 0.05, 25.0, np.array(ranges, np.float32))
        for n in range(3)
    ]
    found = play(
        perception,
        [still("laser", (0, 0, 0.25)), *(Received(scan.stamp_us, "/scan", scan) for scan in scans)],
    )
    assert stamps_of_persons(found) == []
    require_true_watermarks(found)
    assert found[-1].lines_watermark_us is not None


def test_persons_whom_the_robot_has_found_are_told_where_they_stand():
    perception = Perception([PEOPLE])
    stamps = [START_US + n * PERIOD_US for n in range(20)]
    # in an optical frame that looks along x of the map: 3 m ahead, 1 m to the right
    records = [Received(at_us, "/people", poses_at(at_us, "optical", (1.0, 0.2, 3.0))) for at_us in stamps]
    found = play(perception, [still("optical", (5.0, 2.0, 1.2), tuple(LOOKS_AHEAD)), *records])
    last = [each.states for one in found for each in one.persons if len(each.states)][-1]
    assert perception.left_out == {}
    np.testing.assert_allclose(last.position_m, [[8.0, 1.0]], atol=1e-6)


def test_scans_beside_given_poses_tell_of_lines_only(records, legs):
    perception = Perception([PEOPLE, laser(legs, tells_persons=False)])
    found = play(perception, records)
    assert stamps_of_persons(found) == []
    assert sum(len(each.lines) for one in found for each in one.lines) > 0


@pytest.mark.parametrize(
    ("label", "is_person"), [("person", True), ("Pedestrian", True), ("", True), ("chair", False)]
)
def test_boxes_of_persons_alone_are_followed(label, is_person):
    perception = Perception([EYE])
    stamps = [START_US + n * PERIOD_US for n in range(30)]
    records = [Received(at_us, "/boxes", boxes_at(at_us, label)) for at_us in stamps]
    found = play(
        perception,
        [
            Received(START_US, "/info", CAMERA),
            still("optical", (0.0, 0.0, 1.2), tuple(LOOKS_AHEAD)),
            *records,
        ],
    )
    require_true_watermarks(found)
    assert any(len(each.states) for one in found for each in one.persons) is is_person
    assert perception.left_out == ({} if is_person else {"eye: boxes of something that is not a person": 30})


def test_without_camera_info_the_camera_tells_nothing():
    perception = Perception([EYE])
    placed = still("optical", (0.0, 0.0, 1.2), tuple(LOOKS_AHEAD))
    found = play(perception, [placed, Received(START_US, "/boxes", boxes_at(START_US))])
    assert stamps_of_persons(found) == []
    assert perception.left_out == {"eye: no camera_info has come before its images": 1}


def test_without_transforms_everything_is_given_up(records, legs):
    perception = Perception([laser(legs)])
    scans = [each for each in records if isinstance(each.value, Scan)]
    found = play(perception, scans)
    assert said(found[-1:]) == said([Found()])
    assert (perception.placed, perception.given_up) == (0, len(scans))


class NeverAsked:
    """A detector that no image reaches."""


def test_images_that_are_broken_are_counted():
    perception = Perception([Sensor("eye", "camera", "/image", NeverAsked())])
    for number in range(3):
        stamp_us = START_US + number * PERIOD_US
        image = CompressedImage(stamp_us, "optical", b"no jpeg at all")
        perception.take(Received(stamp_us, "/image", image))
    assert sum(perception.left_out.values()) == 3
    assert len(perception.left_out) == 1


@pytest.mark.parametrize("silent", ["camera", "laser"])
def test_a_sensor_that_falls_silent_does_not_hold_the_other(records, legs, silent):
    gap = range(START_US + 2 * SECOND_US, START_US + 4 * SECOND_US)
    both = with_boxes(records, [0] * 180)
    kind = Boxes if silent == "camera" else Scan
    kept = [each for each in both if not (isinstance(each.value, kind) and each.value.stamp_us in gap)]
    perception = Perception(eye_and_laser(legs))
    perception.take(Received(START_US, "/camera_info", CAMERA))
    perception.take(still("optical", (0.0, 0.0, 1.2), tuple(LOOKS_AHEAD)))
    found = play(perception, kept)
    require_true_watermarks(found)
    marks = [one.persons_watermark_us for one in found if one.persons_watermark_us]
    assert max(later - earlier for earlier, later in pairwise(marks)) < SECOND_US
