"""Records that wait for their transform: in order, with their matrix, and never for ever."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.frames.transform_buffer import Missing, TransformBuffer
from semap_ingest.frames.waiting import GivenUp, Ready, WaitingRecords
from semap_ingest.sensing.transform import Transform


@dataclass(frozen=True)
class Seen:
    stamp_us: int
    frame: str = "laser"
    number: int = 0
    sweep_us: int = 0

    @property
    def last_us(self) -> int:
        return self.stamp_us + self.sweep_us


def moved(stamp_us: int, child: str = "laser", parent: str = "map") -> Transform:
    """The frame is at x = its stamp."""
    return Transform(stamp_us, parent, child, np.array([stamp_us, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))


def waiting(patience_us: int = 100, most: int = 1000) -> tuple[TransformBuffer, WaitingRecords[Seen]]:
    buffer = TransformBuffer()
    return buffer, WaitingRecords(buffer, "map", patience_us, most)


def said(results: list[Ready[Seen] | GivenUp[Seen]]) -> list[tuple[str, int, object]]:
    return [
        (
            each.source,
            each.record.stamp_us,
            each.target_T_frame[0, 3] if isinstance(each, Ready) else each.why,
        )
        for each in results
    ]


def test_a_record_goes_out_as_soon_as_its_transform_is_there() -> None:
    buffer, records = waiting()
    buffer.add(moved(0))
    records.put("scan", Seen(10))
    assert records.take() == []
    buffer.add(moved(20))
    assert said(records.take()) == [("scan", 10, 10.0)]
    assert records.take() == []
    assert len(records) == 0


def test_a_source_keeps_its_order_and_does_not_hold_up_another() -> None:
    buffer, records = waiting()
    for child in ("laser", "camera"):
        buffer.add(moved(0, child))
    records.put("scan", Seen(50))
    records.put("scan", Seen(10))
    records.put("image", Seen(5, "camera"))
    buffer.add(moved(20))
    buffer.add(moved(20, "camera"))
    assert said(records.take()) == [("image", 5, 5.0)]
    buffer.add(moved(60))
    assert said(records.take()) == [("scan", 50, 50.0), ("scan", 10, 10.0)]


def test_patience_ends_in_event_time_by_any_source() -> None:
    buffer, records = waiting(patience_us=100)
    buffer.add(moved(0))
    records.put("scan", Seen(10))
    records.put("image", Seen(110, "camera"))
    assert records.take() == []
    records.put("image", Seen(111, "camera"))
    assert said(records.take()) == [("scan", 10, Missing.NOT_YET)]
    assert records.given_up == {("scan", Missing.NOT_YET): 1}


@pytest.mark.parametrize(
    ("record", "why"),
    [
        (Seen(10, "nowhere"), Missing.UNKNOWN_FRAME),
        (Seen(-10), Missing.TOO_EARLY),
        (Seen(10, "arm"), Missing.NOT_CONNECTED),
    ],
)
def test_the_reason_is_what_was_missing_to_the_last(record: Seen, why: Missing) -> None:
    buffer, records = waiting()
    for transform in (moved(0), moved(20), moved(0, "arm", "world")):
        buffer.add(transform)
    records.put("scan", record)
    assert records.take() == []
    records.put("scan", Seen(1000))
    assert said(records.take()) == [("scan", record.stamp_us, why)]


def test_a_late_transform_saves_a_record_that_was_too_early() -> None:
    buffer, records = waiting()
    buffer.add(moved(20))
    records.put("scan", Seen(10))
    assert records.take() == []
    buffer.add(moved(0))
    assert said(records.take()) == [("scan", 10, 10.0)]


def test_a_stamp_in_the_far_future_is_given_up_when_its_source_goes_on() -> None:
    buffer, records = waiting()
    buffer.add(moved(0))
    buffer.add(moved(20))
    records.put("scan", Seen(10**15))
    records.put("scan", Seen(10))
    assert said(records.take()) == [("scan", 10**15, Missing.NOT_YET), ("scan", 10, 10.0)]


def test_time_that_stands_still_does_not_fill_the_memory() -> None:
    _, records = waiting(most=3)
    for number in range(10):
        records.put("scan", Seen(5, "laser", number))
    assert [each.record.number for each in records.take()] == list(range(7))
    assert len(records) == 3


def test_at_the_end_nothing_is_left() -> None:
    buffer, records = waiting()
    buffer.add(moved(0))
    buffer.add(moved(10))
    for stamp_us in (5, 15, 8):
        records.put("scan", Seen(stamp_us))
    assert said(records.flush()) == [("scan", 5, 5.0), ("scan", 15, Missing.NOT_YET), ("scan", 8, 8.0)]
    assert len(records) == 0


@given(
    st.lists(
        st.one_of(
            st.tuples(st.sampled_from(["scan", "image", "cloud"]), st.integers(0, 300)),
            st.tuples(st.just(""), st.integers(0, 300)),
        ),
        max_size=60,
    )
)
def test_every_record_comes_out_once_and_in_the_order_of_its_source(told: list[tuple[str, int]]) -> None:
    buffer, records = waiting(patience_us=40)
    out: list[Ready[Seen] | GivenUp[Seen]] = []
    put: list[tuple[str, Seen]] = []
    for number, (source, stamp_us) in enumerate(told):
        if source:
            put.append((source, Seen(stamp_us, "laser", number)))
            records.put(*put[-1])
        else:
            buffer.add(moved(stamp_us))
        out += records.take()
    out += records.flush()
    for source in ("scan", "image", "cloud"):
        assert [each.record for each in out if each.source == source] == [r for s, r in put if s == source]
    assert sum(records.given_up.values()) == sum(isinstance(each, GivenUp) for each in out)
    for each in out:
        if isinstance(each, Ready):
            assert each.target_T_frame[0, 3] == pytest.approx(each.record.stamp_us)


def test_a_sweep_waits_for_its_end_too_and_goes_without_it_at_last() -> None:
    buffer, records = waiting()
    buffer.add(moved(0))
    records.put("scan", Seen(10, sweep_us=15))
    buffer.add(moved(20))
    assert records.take() == []
    assert records.held_us == 10
    buffer.add(moved(30))
    (ready,) = records.take()
    assert isinstance(ready, Ready)
    assert (ready.target_T_frame[0, 3], ready.target_T_last[0, 3]) == (10.0, 25.0)
    records.put("scan", Seen(20, sweep_us=15))
    (ready,) = records.flush()
    assert isinstance(ready, Ready)
    assert (ready.target_T_frame[0, 3], ready.target_T_last) == (20.0, None)


def test_for_a_file_what_is_newer_than_all_transforms_waits_and_keeps_older_ones() -> None:
    buffer = TransformBuffer(keep_us=100)
    records: WaitingRecords[Seen] = WaitingRecords(buffer, "map", None, most=3)
    buffer.add(moved(0, "odom"))
    for stamp_us in range(0, 3_000_000, 1000):
        buffer.add(moved(stamp_us, "laser", "odom"))
        if stamp_us % 10_000 == 0:
            records.put("scan", Seen(stamp_us, "laser"))
        ready = records.take()
        assert len(ready) == (stamp_us == 0)
    assert records.held_us == 10_000
    buffer.add(moved(3_000_000, "odom"))
    assert [each for each in records.take() if isinstance(each, GivenUp)] == []
    assert len(records) == 0
