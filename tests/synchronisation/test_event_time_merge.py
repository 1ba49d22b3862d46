"""Records of many sources in one order: each once, none behind a watermark, the same whatever comes when."""

from __future__ import annotations

from itertools import groupby

from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.synchronisation.event_time_merge import EventTimeMerge, Moment, Pace

PATIENCE_US = 100
STREAMS = st.lists(
    st.tuples(
        st.lists(st.integers(1, 40), min_size=1, max_size=25),  # gaps between stamps
        st.lists(st.integers(0, 160), min_size=25, max_size=25),  # delays
    ),
    min_size=1,
    max_size=4,
)


def arrivals(streams) -> list[tuple[int, str, int]]:
    """When, of which source, which stamp; in the order of stamps within each source."""
    found = []
    for number, (gaps, delays) in enumerate(streams):
        stamp = last = 0
        for gap, delay in zip(gaps, delays, strict=False):
            stamp += gap
            last = max(last, stamp + delay)
            found.append((last, f"s{number}", stamp))
    return sorted(found)


def merged(streams, patience_us: int = PATIENCE_US) -> tuple[list[Moment[tuple[str, int]]], EventTimeMerge]:
    """All moments, each after the watermark that was told before it."""
    merge: EventTimeMerge[tuple[str, int]] = EventTimeMerge(
        {f"s{number}": Pace(min(gaps), patience_us) for number, (gaps, _) in enumerate(streams)}
    )
    moments: list[Moment[tuple[str, int]]] = []
    for _, source, stamp in arrivals(streams):
        told = merge.watermark_us
        merge.add(source, stamp, (source, stamp))
        merge.come_to(stamp)
        taken = merge.take()
        assert all(each.stamp_us > told for each in taken)
        moments += taken
    moments += merge.flush()
    return moments, merge


@given(STREAMS)
def test_each_record_comes_out_once_in_order_or_is_counted(streams) -> None:
    moments, merge = merged(streams)
    stamps = [each.stamp_us for each in moments]
    assert stamps == sorted(set(stamps))
    out = sorted(item for moment in moments for item in moment.items)
    every = sorted((source, stamp) for _, source, stamp in arrivals(streams))
    assert set(out) <= set(every)
    assert len(out) + sum(merge.refused.values()) == len(every)
    assert all(item[1] == moment.stamp_us for moment in moments for item in moment.items)


@given(STREAMS)
def test_with_patience_enough_it_is_a_merge_by_stamp(streams) -> None:
    moments, merge = merged(streams, patience_us=100_000)
    every = sorted((stamp, source) for _, source, stamp in arrivals(streams))
    oracle = [
        (stamp, tuple((source, stamp) for _, source in group))
        for stamp, group in groupby(every, key=lambda each: each[0])
    ]
    assert [(each.stamp_us, each.items) for each in moments] == oracle
    assert not merge.refused


def test_the_least_periods_give_out_early() -> None:
    merge: EventTimeMerge[str] = EventTimeMerge({"a": Pace(50, 1000), "b": Pace(50, 1000)})
    merge.add("a", 100, "a")
    assert merge.take() == []
    merge.add("b", 90, "b")
    assert [each.items for each in merge.take()] == [("b",), ("a",)]
    assert merge.watermark_us == 139


def test_a_source_that_never_speaks_is_waited_for_by_its_patience() -> None:
    merge: EventTimeMerge[str] = EventTimeMerge({"a": Pace(10, 1000), "b": Pace(10, 200)})
    for stamp in (100, 200, 300):
        merge.add("a", stamp, str(stamp))
        merge.come_to(stamp)
    assert [each.stamp_us for each in merge.take()] == []
    merge.add("a", 401, "401")
    merge.come_to(401)
    assert [each.stamp_us for each in merge.take()] == [100, 200]
