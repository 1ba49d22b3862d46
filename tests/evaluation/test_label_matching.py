from itertools import permutations

from hypothesis import given
from hypothesis import strategies as st
from semap_service.evaluation.matching import Occurrence, match, together

STAMPS = st.lists(st.integers(0, 20), max_size=5)


def at(stamps, kind="entered", place="Room01"):
    return [Occurrence(kind, place, stamp) for stamp in stamps]


@given(STAMPS, STAMPS, st.integers(0, 6))
def test_as_many_pairs_as_can_be_and_the_least_error(labels, found, tolerance):
    scores = match(at(labels), at(found), tolerance)
    few, many = sorted([labels, found], key=len)
    best = max(
        (
            (len(errors), -sum(errors))
            for order in permutations(many, len(few))
            for errors in [[abs(a - b) for a, b in zip(few, order, strict=True) if abs(a - b) <= tolerance]]
        ),
        default=(0, 0),
    )
    assert (len(scores.matched), -sum(abs(ms) * 1000 for ms in scores.errors_ms)) == (best[0], best[1])
    assert sorted(
        [label.stamp_us for label, _ in scores.matched] + [m.stamp_us for m in scores.missed]
    ) == sorted(labels)
    assert sorted(
        [seen.stamp_us for _, seen in scores.matched] + [m.stamp_us for m in scores.made_up]
    ) == sorted(found)


def test_another_room_or_another_kind_is_another_matter():
    scores = match(at([100]), at([100], place="Room02") + at([100], kind="left"), 500)
    assert (len(scores.matched), len(scores.missed), len(scores.made_up)) == (0, 1, 2)
    assert (scores.recall, scores.precision) == (0.0, 0.0)


def test_several_recordings_count_as_one():
    one, other = match(at([0, 100]), at([10]), 20), match(at([0]), at([0, 50]), 20)
    both = together([one, other])
    assert (both.recall, both.precision) == (2 / 3, 2 / 3)
    assert both.errors_ms == [0.01, 0.0]


def test_nothing_is_all_right_where_nothing_was_to_be_found():
    scores = match([], [], 500)
    assert (scores.recall, scores.precision, scores.errors_ms) == (1.0, 1.0, [])


def test_what_took_time_was_at_any_moment_of_it():
    turned = Occurrence("opening", "Door01", 1000, 3000)
    assert [turned.error_us(stamp) for stamp in (400, 1000, 2000, 3000, 3700)] == [-600, 0, 0, 0, 700]
    scores = match([turned], at([3500], kind="opening", place="Door01"), 500)
    assert scores.errors_ms == [0.5]
