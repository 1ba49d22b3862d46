from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matching_oracle import best_pairs, certain_fates
from semap_ingest.synchronisation.synchroniser import (
    NEVER_US,
    AloneA,
    AloneB,
    Matched,
    Refused,
    SourceTiming,
    Synchroniser,
)

from semap.errors import InvalidInput

FAR = 2**63
Arrival = tuple[str, int]


def synchroniser(
    period_a: int = 1, period_b: int = 1, tolerance: int = 5, delay: int = FAR, jump: int = 10**12
) -> Synchroniser[int, int]:
    return Synchroniser(SourceTiming(period_a), SourceTiming(period_b), tolerance, delay, jump)


def add(sync: Synchroniser[int, int], arrival: Arrival) -> tuple[object, ...]:
    side, stamp = arrival
    return sync.add_a(stamp, stamp) if side == "a" else sync.add_b(stamp, stamp)


def event_times(out: object) -> list[tuple[str, int]]:
    match out:
        case Matched(a_us, a, b_us, b):
            assert (a_us, b_us) == (a, b)
            return [("a", a), ("b", b)]
        case AloneA(stamp, _):
            return [("a", stamp)]
        case AloneB(stamp, _):
            return [("b", stamp)]
    raise AssertionError(out)


def stamps_from(draw: st.DrawFn, period: int, most: int, span: int) -> list[int]:
    gaps = draw(st.lists(st.integers(period, period + span), max_size=most))
    first = draw(st.integers(0, span))
    stamps = [first]
    for gap in gaps:
        stamps.append(stamps[-1] + gap)
    return stamps


@st.composite
def streams(draw: st.DrawFn, most: int = 12, span: int = 12) -> tuple[int, int, int, list[Arrival]]:
    """Periods, tolerance, and arrivals of both sources, each in its own order, mixed in any way."""
    periods = draw(st.integers(1, 8)), draw(st.integers(1, 8))
    a, b = (stamps_from(draw, period, most, span) for period in periods)
    sides = draw(st.permutations(["a"] * len(a) + ["b"] * len(b)))
    coming = {"a": iter(a), "b": iter(b)}
    return *periods, draw(st.integers(0, 12)), [(side, next(coming[side])) for side in sides]


def of_side(arrivals: list[Arrival], side: str) -> tuple[int, ...]:
    return tuple(stamp for each, stamp in arrivals if each == side)


@given(streams())
def test_any_interleaving_gives_the_pairs_of_the_whole_sequences(
    stream: tuple[int, int, int, list[Arrival]],
) -> None:
    period_a, period_b, tolerance, arrivals = stream
    sync = synchroniser(period_a, period_b, tolerance)
    out: list[object] = []
    for arrival in arrivals:
        before = sync.watermark_us
        more = add(sync, arrival)
        assert all(stamp > before for each in more for _, stamp in event_times(each))
        assert sync.watermark_us >= before
        out += more
    out += sync.flush()

    a, b = of_side(arrivals, "a"), of_side(arrivals, "b")
    assert {(each.a, each.b) for each in out if isinstance(each, Matched)} == best_pairs(a, b, tolerance)
    given_out = [record for each in out for record in event_times(each)]
    assert sorted(given_out) == sorted(arrivals)
    assert tuple(stamp for side, stamp in given_out if side == "a") == a
    assert tuple(stamp for side, stamp in given_out if side == "b") == b
    first_stamps = [min(stamp for _, stamp in event_times(each)) for each in out]
    assert first_stamps == sorted(first_stamps)
    assert not sync.refused


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_nothing_waits_once_no_future_can_change_it(data: st.DataObject) -> None:
    """The records given out are exactly those whose fate is the same in all futures, and the watermark is exact."""
    periods = data.draw(st.integers(1, 4)), data.draw(st.integers(2, 4))
    tolerance = data.draw(st.integers(0, 4))
    delay = data.draw(st.sampled_from([4, 6, FAR]))
    a, b = ([x for x in stamps_from(data.draw, period, 3, 2) if x < 9] for period in periods)
    sides = data.draw(st.permutations(["a"] * len(a) + ["b"] * len(b)))
    coming = {"a": iter(a), "b": iter(b)}
    sync = synchroniser(*periods, tolerance, delay)
    had: dict[str, list[int]] = {"a": [], "b": []}
    given_out: dict[Arrival, int | None] = {}
    for side in sides:
        stamp = next(coming[side])
        out = add(sync, (side, stamp))
        if any(isinstance(each, Refused) for each in out):
            assert stamp < max(had["a"] + had["b"]) - delay
            return
        had[side].append(stamp)
        for each in out:
            records = event_times(each)
            given_out |= {record: other[1] for record, other in zip(records, records[::-1], strict=True)}
            if len(records) == 1:
                given_out[records[0]] = None
        frontiers = tuple(
            max([NEVER_US, *(x + period for x in had[own]), *(y - delay for y in had[other])])
            for own, other, period in (("a", "b", periods[0]), ("b", "a", periods[1]))
        )
        can_come_from = (max(0, frontiers[0]), max(0, frontiers[1]))
        horizon = max(had["a"] + had["b"]) + tolerance + 3
        assert given_out == certain_fates(
            tuple(had["a"]), tuple(had["b"]), can_come_from, periods, tolerance, horizon
        )
        waiting = [x for own in "ab" for x in had[own] if (own, x) not in given_out]
        assert sync.watermark_us == max(NEVER_US, min(*waiting, *frontiers) - 1)


def test_the_image_after_the_scan_completes_the_pair() -> None:
    sync = synchroniser(30, 60, tolerance=20)
    assert add(sync, ("a", 0)) == ()
    assert add(sync, ("b", 30)) == (AloneA(0, 0),)
    assert add(sync, ("a", 33)) == (Matched(33, 33, 30, 30),)
    assert sync.watermark_us == 62


def test_a_scan_does_not_wait_for_an_image_that_cannot_be_nearer() -> None:
    sync = synchroniser(30, 60, tolerance=20)
    assert add(sync, ("a", 20)) == ()
    assert add(sync, ("b", 30)) == (Matched(20, 20, 30, 30),)


def test_a_scan_waits_for_an_image_that_could_be_nearer() -> None:
    sync = synchroniser(30, 60, tolerance=20)
    assert add(sync, ("a", 10)) == ()
    assert add(sync, ("b", 30)) == ()
    assert add(sync, ("a", 44)) == (AloneA(10, 10), Matched(44, 44, 30, 30))


def test_a_throttled_source_is_not_awaited_when_its_next_record_is_too_far() -> None:
    sync = synchroniser(130, 60, tolerance=40)
    assert add(sync, ("a", 0)) == ()
    assert add(sync, ("b", 10)) == (Matched(0, 0, 10, 10),)
    assert add(sync, ("b", 77)) == (AloneB(77, 77),)
    assert add(sync, ("a", 133)) == ()
    assert add(sync, ("b", 143)) == (Matched(133, 133, 143, 143),)


def test_of_two_rivals_the_nearer_wins_and_the_other_takes_its_next_best() -> None:
    sync = synchroniser(1, 1, tolerance=5)
    out = [each for arrival in (("a", 10), ("b", 13), ("a", 14), ("b", 18)) for each in add(sync, arrival)]
    assert [*out, *sync.flush()] == [AloneA(10, 10), Matched(14, 14, 13, 13), AloneB(18, 18)]
    out = [each for arrival in (("b", 26), ("a", 30), ("b", 33), ("a", 37)) for each in add(sync, arrival)]
    assert [*out, *sync.flush()] == [AloneB(26, 26), Matched(30, 30, 33, 33), AloneA(37, 37)]
    out = [each for arrival in (("b", 46), ("a", 50), ("b", 55), ("a", 58)) for each in add(sync, arrival)]
    assert [*out, *sync.flush()] == [Matched(50, 50, 46, 46), Matched(58, 58, 55, 55)]


def test_of_two_equally_near_the_earlier_is_taken() -> None:
    sync = synchroniser(10, 1, tolerance=5)
    add(sync, ("a", 10))
    assert add(sync, ("b", 15)) == (Matched(10, 10, 15, 15),)
    assert add(sync, ("a", 20)) == ()
    assert sync.flush() == (AloneA(20, 20),)


def test_the_tolerance_itself_is_near_enough_and_equal_stamps_always_are() -> None:
    sync = synchroniser(1, 1, tolerance=5)
    out = [*add(sync, ("a", 0)), *add(sync, ("b", 5)), *sync.flush()]
    assert out == [Matched(0, 0, 5, 5)]
    exact = synchroniser(1, 1, tolerance=0)
    assert [*add(exact, ("b", 7)), *add(exact, ("a", 7))] == [Matched(7, 7, 7, 7)]


def test_a_silent_source_is_waited_for_no_longer_than_the_delay() -> None:
    sync = synchroniser(30, 60, tolerance=20, delay=150)
    assert sync.watermark_us == NEVER_US
    out = [add(sync, ("b", stamp)) for stamp in range(0, 601, 67)]
    assert out[:3] == [(), (), ()]
    assert out[3:] == [(AloneB(stamp, stamp),) for stamp in range(0, 401, 67)]
    assert sync.watermark_us == 385
    assert add(sync, ("a", 385)) == (Refused(385, "a", 385, "too_late"),)
    assert add(sync, ("a", 395)) == (Matched(395, 395, 402, 402),)
    assert sync.refused == {"too_late": 1}


def test_what_is_out_of_order_or_twice_is_refused_and_counted() -> None:
    sync = synchroniser()
    add(sync, ("a", 10))
    assert add(sync, ("a", 10)) == (Refused(10, "a", 10, "out_of_order"),)
    assert add(sync, ("a", 3)) == (Refused(3, "a", 3, "out_of_order"),)
    assert add(sync, ("b", 10)) == (Matched(10, 10, 10, 10),)
    assert sync.refused == {"out_of_order": 2}


def test_a_record_sooner_than_its_minimum_period_is_welcome_where_nothing_is_out() -> None:
    sync = synchroniser(30, 30, tolerance=10)
    add(sync, ("a", 0))
    assert add(sync, ("a", 20)) == ()
    assert add(sync, ("b", 21)) == (AloneA(0, 0), Matched(20, 20, 21, 21))
    assert add(sync, ("a", 40)) == (Refused(40, "a", 40, "too_late"),)


def test_one_stray_stamp_from_far_ahead_harms_nothing() -> None:
    sync = synchroniser(30, 30, tolerance=10, delay=100, jump=1000)
    add(sync, ("a", 0))
    assert add(sync, ("a", 10**6)) == ()
    assert add(sync, ("b", 2)) == (Matched(0, 0, 2, 2),)
    assert add(sync, ("a", 40)) == (Refused(10**6, "a", 10**6, "stray"),)
    assert add(sync, ("b", 41)) == (Matched(40, 40, 41, 41),)


def test_event_time_goes_on_after_a_pause_of_both_sources() -> None:
    sync = synchroniser(30, 30, tolerance=10, delay=100, jump=1000)
    add(sync, ("a", 0))
    assert add(sync, ("b", 5000)) == ()
    assert add(sync, ("a", 5001)) == (AloneA(0, 0), Matched(5001, 5001, 5000, 5000))
    assert not sync.refused


def test_two_different_leaps_are_not_believed() -> None:
    sync = synchroniser(30, 30, tolerance=10, delay=100, jump=1000)
    add(sync, ("a", 0))
    add(sync, ("a", 10**6))
    assert add(sync, ("b", 10**9)) == (Refused(10**6, "a", 10**6, "stray"),)
    assert sync.flush() == (Refused(10**9, "b", 10**9, "stray"), AloneA(0, 0))
    assert sync.refused == {"stray": 2}


def test_a_leap_of_one_source_is_believed_when_the_other_has_walked_up_to_it() -> None:
    sync = synchroniser(30, 30, tolerance=10, delay=5000, jump=1000)
    add(sync, ("a", 0))
    assert add(sync, ("a", 1500)) == ()
    assert add(sync, ("b", 800)) == (AloneA(0, 0), AloneB(800, 800))
    assert add(sync, ("b", 1501)) == (Matched(1500, 1500, 1501, 1501),)


@given(st.lists(st.tuples(st.sampled_from("ab"), st.integers(-50, 400)), max_size=40), st.integers(0, 60))
def test_whatever_comes_goes_out_exactly_once_and_in_order(arrivals: list[Arrival], delay: int) -> None:
    """Broken promises of all kinds: stamps back and forth, too soon, too late, astray."""
    sync = synchroniser(5, 7, tolerance=6, delay=delay, jump=100)
    out: list[object] = []
    for arrival in arrivals:
        before = sync.watermark_us
        more = add(sync, arrival)
        accepted = [each for each in more if not isinstance(each, Refused)]
        assert all(stamp > before for each in accepted for _, stamp in event_times(each))
        assert sync.watermark_us >= before
        out += more
    out += sync.flush()
    refused = [(each.side, each.stamp_us) for each in out if isinstance(each, Refused)]
    accepted_records = [
        record for each in out if not isinstance(each, Refused) for record in event_times(each)
    ]
    assert sorted(refused + accepted_records) == sorted(arrivals)
    assert len(refused) == sync.refused.total()
    for side in "ab":
        stamps = [stamp for each, stamp in accepted_records if each == side]
        assert stamps == sorted(set(stamps))


def test_a_flush_ends_the_waiting_and_the_sources_may_go_on() -> None:
    sync = synchroniser(30, 30, tolerance=10)
    assert sync.flush() == ()
    add(sync, ("a", 100))
    assert sync.flush() == (AloneA(100, 100),)
    assert sync.watermark_us == 100
    assert sync.flush() == ()
    assert add(sync, ("b", 125)) == ()
    assert add(sync, ("a", 130)) == (Matched(130, 130, 125, 125),)


@pytest.mark.parametrize(
    "durations", [(-1, 0, 0, 0, 9), (0, -1, 0, 0, 9), (0, 0, -1, 0, 9), (0, 0, 0, -1, 9), (10, 0, 0, 0, 10)]
)
def test_impossible_durations_are_refused(durations: tuple[int, int, int, int, int]) -> None:
    with pytest.raises(InvalidInput) as refused:
        synchroniser(*durations)
    assert refused.value.remedy
