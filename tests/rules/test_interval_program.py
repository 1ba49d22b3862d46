"""Pairs of intervals, against an oracle that looks at every future of each pair."""

from itertools import product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rules.interval_rows import new_state, nothing_measured, relation, run, run_by_deadlines, said, where
from rules.test_allen import relations_of

from semap.errors import InvalidInput
from semap.rules.declaration import Windows
from semap.rules.interval.allen import APART, RELATIONS
from semap.rules.interval.interval_program import IntervalProgram

END = 10**6
IN_ROOM = where(of="in_room", type="began")
DOOR_OPEN = where(of="door", type="open")


def program(relations, window=None, left="P", right="D", conditions=None, finish=nothing_measured):
    conditions = conditions or {"P": IN_ROOM, "D": DOOR_OPEN}
    return IntervalProgram(left, frozenset(relations), right, Windows(window), conditions, "found", finish)


# --- the oracle -------------------------------------------------------------------------------------------


def intervals_of(rows):
    """(variable, begin, end or None) of a whole stream; those without length are left out."""
    found = []
    for place, row in enumerate(rows):
        values = row.values
        if row.source == "relation" and values["type"] == "began":
            variable = "P"
        elif row.source == "object_state" and values["type"] == "open":
            variable = "D"
        else:
            continue
        mine = ("input", "track_id", "instance_id")
        ends = (
            later for later in rows[place + 1 :] if all(later.values.get(n) == values.get(n) for n in mine)
        )
        end = next(ends, None)
        if end is None or end.stamp_us > row.stamp_us:
            found.append((variable, row, end))
    return found


def futures(interval, now):
    """The intervals that it may still be, as far as is known now."""
    _, begin, end = interval
    if end is not None and end.stamp_us <= now:
        return [(begin.stamp_us, end.stamp_us)]
    return [(begin.stamp_us, now + more) for more in (1, 2, 3)]


def expected(rows, relations, window):
    found = []
    intervals = intervals_of(rows)
    for left, right in product(intervals, repeat=2):
        if (left[0], right[0]) != ("P", "D"):
            continue
        both_begun = max(left[1].stamp_us, right[1].stamp_us)
        for now in range(both_begun, max(row.stamp_us for row in rows) + 1):
            still = set()
            for one, other in product(futures(left, now), futures(right, now)):
                still |= relations_of(one, other)
            if still <= relations:
                if window is None or now - min(left[1].stamp_us, right[1].stamp_us) < window:
                    found.append((now, bound(left, right, now)))
                break
    found.sort(key=lambda each: (each[0], [row.order for _, row in each[1]]))
    return [("found", now, [(variable, row.uid) for variable, row in rows]) for now, rows in found]


def bound(left, right, now):
    rows = [
        (variable, row)
        for variable, begin, end in (left, right)
        for row in (begin, end)
        if row is not None and row.stamp_us <= now
    ]
    return sorted(rows, key=lambda each: each[1].order)


# --- hypothesis -------------------------------------------------------------------------------------------


@st.composite
def streams(draw):
    """Persons go in and out and doors open and close, several things at a moment; some never end."""
    rows = []
    inside, state = set(), {}
    for stamp_us in sorted(draw(st.lists(st.integers(0, 12), max_size=14))):
        if draw(st.booleans()):
            track = draw(st.integers(1, 3))
            kind = "ended" if track in inside else "began"
            inside ^= {track}
            row = relation(stamp_us, kind, "in_room", track)
        else:
            door = draw(st.integers(1, 2))
            value = draw(st.sampled_from(["open", "closed", "ajar"]))
            if state.get(door) == value:
                continue
            state[door] = value
            row = new_state(stamp_us, "door", value, door)
        if all(row.uid != other.uid for other in rows):
            rows.append(row)
    rows.sort(key=lambda row: row.order)
    return rows


relation_sets = st.sets(st.sampled_from(sorted(RELATIONS)), min_size=1).map(frozenset)


@settings(max_examples=400, deadline=None)
@given(streams(), relation_sets, st.none() | st.integers(1, 14))
def test_each_pair_is_found_once_and_as_early_as_no_future_contradicts(rows, relations, window):
    if window is None and relations & APART:
        window = 100
    asked = program(relations, window)
    _, found = run(asked, rows, END)
    assert said(found) == expected(rows, relations, window) if rows else not found


@settings(max_examples=200, deadline=None)
@given(streams(), relation_sets, st.integers(1, 14), st.sets(st.integers(-1, 30)))
def test_no_cut_and_no_watermark_changes_what_is_found(rows, relations, window, advances):
    asked = program(relations, window)
    _, whole = run(asked, rows, END)
    state, in_pieces = run(asked, rows, END, advances, stored=True)
    assert said(in_pieces) == said(whole)
    assert state is None
    state, announced = run_by_deadlines(asked, rows, END)
    assert said(match for _, match in announced) == said(whole)
    assert [given_us for given_us, _ in announced] == [match.stamp_us for match in whole]
    assert state is None


# --- by hand ----------------------------------------------------------------------------------------------


def test_overlaps_is_known_when_the_first_ends_while_the_second_is_open():
    rows = [
        relation(10, "began", "in_room"),
        new_state(20, "door", "open"),
        relation(30, "ended", "in_room"),
        new_state(90, "door", "closed"),
    ]
    _, found = run(program({"overlaps"}), rows, END)
    assert said(found) == [
        ("found", 30, [("P", rows[0].uid), ("D", rows[1].uid), ("P", rows[2].uid)]),
    ]


def test_a_disjunction_is_known_before_either_end():
    rows = [new_state(10, "door", "open"), relation(20, "began", "in_room")]
    _, found = run(program({"during", "finishes", "overlappedBy"}), rows, END)
    assert said(found) == [("found", 20, [("D", rows[0].uid), ("P", rows[1].uid)])]


def test_before_is_known_when_the_second_begins_and_within_its_window():
    rows = [
        relation(10, "began", "in_room"),
        relation(20, "ended", "in_room"),
        new_state(29, "door", "open"),
        new_state(40, "door", "closed"),
        new_state(50, "door", "open"),
    ]
    assert [match.stamp_us for match in run(program({"before"}, 20), rows, END)[1]] == [29]
    assert [match.stamp_us for match in run(program({"before"}, 19), rows, END)[1]] == []
    assert [match.stamp_us for match in run(program({"before"}, 41), rows, END)[1]] == [29, 50]


def test_what_begins_in_the_moment_of_another_end_meets_it():
    rows = [new_state(10, "door", "open"), new_state(20, "door", "closed"), new_state(30, "door", "open")]
    both = {"P": where(type="open"), "D": where(type="closed")}
    _, found = run(program({"meets"}, conditions=both), rows, END)
    assert said(found) == [
        ("found", 20, [("P", rows[0].uid), ("P", rows[1].uid), ("D", rows[1].uid)]),
    ]


def test_two_intervals_of_one_variable_are_one_pair_and_none_is_paired_with_itself():
    rows = [relation(10, "began", "in_room", 1), relation(20, "began", "in_room", 2)]
    asked = program(RELATIONS - APART, left="P", right="P")
    _, found = run(asked, rows, END)
    assert said(found) == [("found", 20, [("P", rows[0].uid), ("P", rows[1].uid)])]


def test_an_interval_without_length_is_none():
    rows = [
        new_state(5, "door", "open"),
        new_state(10, "door", "closed"),
        new_state(10, "door", "open"),
        new_state(10, "door", "ajar"),
        relation(10, "began", "in_room"),
    ]
    _, found = run(program(RELATIONS, 100), rows, END)
    assert said(found) == [("found", 10, [("D", rows[0].uid), ("D", rows[1].uid), ("P", rows[4].uid)])]


def test_measures_see_the_begin_first_and_what_is_known_last():
    seen = []

    def finish(last, stamp_us):
        seen.append(([(each.variable, each.row.stamp_us) for each in last.latest_first()], stamp_us))
        return {"held_s": 1}, 0.5

    rows = [relation(1, "began", "in_room"), new_state(2, "door", "open"), new_state(3, "door", "closed")]
    _, (match,) = run(program({"contains"}, finish=finish), rows, END)
    assert seen == [([("D", 3), ("D", 2), ("P", 1)], 3)]
    assert (match.measures, match.confidence) == ({"held_s": 1}, 0.5)
    assert run(program({"contains"}, finish=lambda last, stamp_us: None), rows, END)[1] == []


def test_memory_holds_what_is_open_and_with_a_window_no_more_than_it():
    visits = [
        relation(10 * visit + offset, kind, "in_room", visit)
        for visit in range(500)
        for offset, kind in ((0, "began"), (5, "ended"))
    ]
    apart = program({"before"}, 100)
    shared = program({"during"})
    state = other = None
    for row in visits:
        state, _ = apart.step(state, row)
        other, _ = shared.step(other, row)
        assert state is None or len(state.intervals) <= 11
        assert other is None or len(other.intervals) <= 2
    assert apart.advance(state, visits[-1].stamp_us + 100)[0] is None
    forgotten, _ = program({"during"}, 100).step(None, new_state(0, "door", "open"))
    assert program({"during"}, 100).advance(forgotten, 99)[0] is None


@pytest.mark.parametrize(
    ("relations", "windows", "message"),
    [
        ({"before"}, Windows(), "need a window"),
        ({"near"}, Windows(), "near is no relation"),
        (set(), Windows(), "nothing is no relation"),
        ({"during"}, Windows(step_us=5), "one window"),
        ({"during"}, Windows(variables={"P": 5}), "one window"),
    ],
)
def test_what_cannot_be_is_refused(relations, windows, message):
    with pytest.raises(InvalidInput, match=message) as caught:
        IntervalProgram("P", frozenset(relations), "D", windows, {}, "found", nothing_measured)
    assert caught.value.remedy
