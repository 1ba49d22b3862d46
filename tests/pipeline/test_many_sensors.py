"""Any number of sensors: one person is one track, whoever sees it, and whatever comes when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from semap_ingest.laser.detector import LegDetector
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.sensor import Sensor
from semap_ingest.recording.reading import Received
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.transform import Transform
from watched_hall import SECOND_US, START_US, Eye, in_order, states_of, told_of, tracks_of, watch

from semap.errors import InvalidInput

WEST, EAST = Eye("west", 0.0, 0.0, 0.0), Eye("east", 10.0, 0.0, np.pi)
AWAY = Eye("away", 0.0, 0.0, np.pi)
FINDER = Sensor("finder", "finder", "/people", period_us=90_000)


def strolls(time_s: float) -> tuple[float, float]:
    return 3.0 + 0.5 * time_s, 0.3


def stands(time_s: float) -> tuple[float, float]:
    return 6.5, -1.5


def crosses(time_s: float) -> tuple[float, float]:
    return 5.0, 2.0 - 0.5 * time_s


@pytest.mark.parametrize("shift_s", [0.0, 0.001, 0.03, 0.05])
@pytest.mark.parametrize("ways", [(strolls,), (strolls, stands)], ids=["one person", "two persons"])
def test_a_person_whom_two_cameras_see_is_one_track(ways, shift_s: float) -> None:
    east = replace(EAST, first_s=shift_s)
    found = watch(
        [WEST, east],
        [WEST.sensor(), east.sensor()],
        in_order(WEST.records(ways, 6.0), east.records(ways, 6.0)),
    )
    assert tracks_of(found) == set(range(1, len(ways) + 1))
    for states in states_of(found)[10:]:
        truth = np.array([way((states.stamp_us - START_US) / SECOND_US) for way in ways])
        for place in states.position_m:
            assert np.hypot(*(truth - place).T).min() < 0.4


def test_at_one_stamp_a_person_is_told_once_whoever_saw_it() -> None:
    found = watch(
        [WEST, EAST],
        [WEST.sensor(), EAST.sensor()],
        in_order(WEST.records([strolls], 4.0), EAST.records([strolls], 4.0)),
    )
    stamps = [states.stamp_us for states in states_of(found)]
    assert len(stamps) == len(set(stamps))
    assert max(len(states) for states in states_of(found)) == 1


def test_two_cameras_know_the_place_better_than_either() -> None:
    def spread(*eyes: Eye) -> float:
        records = in_order(*(eye.records([stands], 4.0) for eye in eyes))
        last = states_of(watch(eyes, [eye.sensor() for eye in eyes], records))[-1]
        return float(np.linalg.eigvalsh(last.covariance_m2[0])[-1])

    assert spread(WEST, EAST) < min(spread(WEST), spread(EAST))


def test_a_camera_that_looks_elsewhere_does_not_put_off_a_person() -> None:
    alone = watch([WEST], [WEST.sensor()], WEST.records([strolls], 4.0))
    beside = watch(
        [WEST, AWAY],
        [WEST.sensor(), AWAY.sensor()],
        in_order(WEST.records([strolls], 4.0), AWAY.records([strolls], 4.0)),
    )
    assert states_of(beside)[0].stamp_us == states_of(alone)[0].stamp_us
    assert tracks_of(beside) == {1}


def said(found) -> list[tuple]:
    """States to compare, bit by bit."""
    return [
        (each.stamp_us, each.track.tolist(), each.position_m.tobytes(), each.covariance_m2.tobytes())
        for each in states_of(found)
    ]


@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_the_order_of_arrival_changes_nothing_within_the_patience_of_each(data: st.DataObject) -> None:
    ways = [strolls, crosses]
    eyes = [WEST, replace(EAST, first_s=0.033), Eye("south", 5.0, -5.0, np.pi / 2, 0.017, 0.25)]
    delays_s = [data.draw(st.sampled_from([0.0, 0.04, 0.11, 0.6, 1.3])) for _ in eyes]
    sensors = [
        *(
            eye.sensor(patience_us=250_000 + round(1.2e6 * delay))
            for eye, delay in zip(eyes, delays_s, strict=True)
        ),
        FINDER,
    ]
    finder = told_of(ways, 3.0, first_s=0.071)
    at_once = in_order(*(eye.records(ways, 3.0) for eye in eyes), finder)
    delayed = in_order(
        *(eye.records(ways, 3.0, delay) for eye, delay in zip(eyes, delays_s, strict=True)), finder
    )
    assert said(watch(eyes, sensors, delayed)) == said(watch(eyes, sensors, at_once))


def test_a_sensor_that_falls_silent_holds_nobody_and_comes_back() -> None:
    west = WEST.records([stands], 8.0)
    east = [each for each in EAST.records([stands], 8.0) if not 2 < (each.sent_us - START_US) / SECOND_US < 6]
    records = in_order(west, east)
    found = watch([WEST, EAST], [WEST.sensor(), EAST.sensor()], records)
    assert tracks_of(found) == {1}
    for record, one in zip(records, found[:-1], strict=True):
        if record.sent_us > START_US + SECOND_US:
            assert one.persons_watermark_us is not None
            assert one.persons_watermark_us >= record.sent_us - 400_000


def test_hints_of_one_sensor_are_none_of_another() -> None:
    """Both cameras number their boxes from 1: who is 1 to the one is 2 to the other."""
    ways = [strolls, crosses]
    east = replace(EAST, first_s=0.05)
    records = in_order(WEST.records(ways, 5.0), east.records(ways[::-1], 5.0))
    found = watch([WEST, east], [WEST.sensor(), east.sensor()], records)
    assert tracks_of(found) == {1, 2}
    amendments = [one for each in found for persons in each.persons for one in persons.states.amendments]
    assert amendments == []


def test_two_lasers_tell_lines_in_the_order_of_event_time() -> None:
    legs = LegDetector.open()
    lasers = [
        Sensor(name, "laser", f"/{name}", legs, period_us=90_000, patience_us=400_000)
        for name in ("front", "back")
    ]
    perception = Perception(lasers)
    wall_m = (2.0 / np.cos(np.linspace(-0.5, 0.5, 181))).astype(np.float32)
    records = []
    for number in range(30):
        for name, shift_us, delay_us in (("front", 0, 0), ("back", 40_000, 150_000)):
            stamp_us = START_US + number * 100_000 + shift_us
            scan = Scan(stamp_us, name, -0.5, 1 / 180, 0.1, 20.0, wall_m)
            records.append(Received(stamp_us + delay_us, f"/{name}", scan))
    for name in ("front", "back"):
        stays = Transform(
            START_US, "map", name, np.array([1.0, 1.0, 0.3]), np.array([0, 0, 0, 1.0]), is_static=True
        )
        perception.take(Received(START_US, "/tf_static", stays))
    mark_us, stamps = 0, []
    for each in [*(perception.take(record) for record in in_order(records)), perception.flush()]:
        for lines in each.lines:
            assert lines.lines.stamp_us > mark_us
            stamps.append(lines.lines.stamp_us)
        mark_us = max(mark_us, each.lines_watermark_us or mark_us)
    assert stamps == sorted(scan.value.stamp_us for scan in records)
    assert perception.left_out == {}


def test_a_frame_that_is_fixed_stays_where_it_is_said_to_be() -> None:
    perception = Perception(
        [FINDER], fixed=[Transform(0, "map", "room", np.array([5.0, 0, 0]), np.array([0, 0, 0, 1.0]), True)]
    )
    astray = Transform(START_US, "map", "room", np.zeros(3), np.array([0, 0, 0, 1.0]), is_static=True)
    perception.take(Received(START_US, "/tf_static", astray))
    poses = [replace(each, value=replace(each.value, frame="room")) for each in told_of([stands], 2.0)]
    last = states_of([perception.take(each) for each in poses])[-1]
    np.testing.assert_allclose(last.position_m, [[11.5, -1.5]], atol=1e-6)


def test_a_clock_that_is_off_is_set_right_by_its_offset() -> None:
    late = [
        replace(each, value=replace(each.value, stamp_us=each.value.stamp_us - 3 * SECOND_US))
        for each in told_of([strolls], 4.0)
    ]
    perception = Perception([replace(FINDER, offset_us=3 * SECOND_US), WEST.sensor()])
    for eye in (WEST,):
        perception.take(Received(START_US, "/tf_static", eye.stands()))
        perception.take(Received(START_US, "/info", eye.camera))
    records = in_order(late, WEST.records([strolls], 4.0))
    found = [*(perception.take(each) for each in records), perception.flush()]
    assert tracks_of(found) == {1}
    assert perception.left_out == {}


@pytest.mark.parametrize(
    ("sensors", "says"),
    [
        ([FINDER, replace(FINDER, topic="/others")], "two sensors have the name 'finder'"),
        ([FINDER, replace(FINDER, name="other")], "two sensors have the topic '/people'"),
        ([WEST.sensor(partner="finder"), FINDER], "west cannot be fused with 'finder'"),
        ([Sensor(f"s{n}", "finder", f"/{n}") for n in range(63)], "63 sensors"),
    ],
)
def test_sensors_that_do_not_fit_together_are_refused(sensors: list[Sensor], says: str) -> None:
    with pytest.raises(InvalidInput, match=says):
        Perception(sensors)
