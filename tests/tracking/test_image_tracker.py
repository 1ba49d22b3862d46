"""Image tracks of persons who walk past a pinhole camera."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.tracking.image_tracker import ImageTracker
from semap_ingest.tracking.overlap import jaccard_index
from shapely import box as rectangle
from shapely import intersection, union

from semap.errors import InvalidInput

FOCAL_PX = 320.0


def boxes(
    stamp_us: int, corners_px: object, score: object = 0.97, label: tuple[str, ...] | None = None
) -> Boxes:
    corners = np.asarray(corners_px, np.float64).reshape(-1, 4)
    count = len(corners)
    return Boxes(
        stamp_us,
        "camera_optical",
        corners,
        np.broadcast_to(np.asarray(score, np.float64), count).copy(),
        label or ("person",) * count,
        np.full(count, -1, np.int64),
    )


def seen_as(x_m: float, z_m: float) -> list[float]:
    """Corners of a person 0.5 m wide and 1.7 m high, seen from a camera 1.2 m above the floor."""
    left, right = FOCAL_PX * (x_m - 0.25) / z_m + 320, FOCAL_PX * (x_m + 0.25) / z_m + 320
    return [left, FOCAL_PX * (1.2 - 1.7) / z_m + 240, right, FOCAL_PX * 1.2 / z_m + 240]


def passing(
    rate_hz: float, seconds: float, *ways: tuple[float, float, float]
) -> list[tuple[int, list[list[float]]]]:
    """Frames of persons who each start at x, at depth z, and walk at a speed across the view."""
    frames = []
    for frame in range(int(seconds * rate_hz)):
        time_s = frame / rate_hz
        frames.append((round(time_s * 1e6), [seen_as(x + speed * time_s, z) for x, z, speed in ways]))
    return frames


def tracks_of(frames: list[Boxes], tracker: ImageTracker | None = None) -> list[list[int]]:
    tracker = tracker or ImageTracker()
    return [tracker.step(frame).track.tolist() for frame in frames]


def seconds_until_told(score: float, rate_hz: float) -> float:
    frames = [boxes(stamp, corners, score) for stamp, corners in passing(rate_hz, 3.0, (0.0, 3.0, 0.3))]
    return next(n for n, (number,) in enumerate(tracks_of(frames)) if number > 0) / rate_hz


@given(
    left=arrays.arrays(np.float64, (3, 4), elements=st.floats(-50, 50)),
    right=arrays.arrays(np.float64, (2, 4), elements=st.floats(-50, 50)),
)
@settings(max_examples=50, deadline=None)
def test_jaccard_index_is_that_of_the_shapes(left: np.ndarray, right: np.ndarray) -> None:
    left = np.hstack([np.minimum(left[:, :2], left[:, 2:]), np.maximum(left[:, :2], left[:, 2:]) + 0.01])
    right = np.hstack([np.minimum(right[:, :2], right[:, 2:]), np.maximum(right[:, :2], right[:, 2:]) + 0.01])
    index = jaccard_index(left, right)
    for row, ours in enumerate(left):
        for column, theirs in enumerate(right):
            one, other = rectangle(*ours), rectangle(*theirs)
            expected = intersection(one, other).area / union(one, other).area
            assert abs(index[row, column] - expected) < 1e-6


@pytest.mark.parametrize("rate_hz", [30.0, 15.0, 7.5])
def test_a_person_who_walks_past_is_one_track_at_any_rate(rate_hz: float) -> None:
    frames = [boxes(stamp, corners) for stamp, corners in passing(rate_hz, 2.5, (-2.0, 2.5, 1.5))]
    assert tracks_of(frames) == [[-1]] + [[1]] * (len(frames) - 1)


@pytest.mark.parametrize("rate_hz", [30.0, 15.0, 7.5])
def test_the_weaker_its_boxes_the_longer_until_somebody_is_told(rate_hz: float) -> None:
    strong_s, fair_s, weak_s = (seconds_until_told(score, rate_hz) for score in (0.95, 0.7, 0.55))
    assert 0 < strong_s < fair_s < weak_s < 1.0


@pytest.mark.parametrize("score", [0.55, 0.7, 0.95])
def test_it_takes_as_long_at_any_rate(score: float) -> None:
    fast_s, slow_s = seconds_until_told(score, 30.0), seconds_until_told(score, 10.0)
    assert abs(fast_s - slow_s) < 0.15


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_what_is_seen_once_in_its_place_is_never_told(seed: int) -> None:
    random = np.random.default_rng(seed)
    columns = random.permutation(40)
    frames = [
        boxes(33_000 * n, [[15 * x, 100, 15 * x + 10, 140]], random.uniform(0.5, 1))
        for n, x in enumerate(columns)
    ]
    assert tracks_of(frames) == [[-1]] * len(frames)


def test_who_has_weak_boxes_alone_for_seconds_is_believed_no_more() -> None:
    stamps = [33_000 * n for n in range(240)]
    scores = [0.6] * 60 + [0.2] * 180
    told = tracks_of(
        [boxes(stamp, [seen_as(0, 3)], score) for stamp, score in zip(stamps, scores, strict=True)]
    )
    assert told[59] == [1]
    assert told[75] == [1]
    assert told[-1] == [-1]


@pytest.mark.parametrize("rate_hz", [30.0, 7.5])
def test_a_gap_of_half_a_second_does_not_part_a_track(rate_hz: float) -> None:
    frames = [
        boxes(stamp, corners)
        for stamp, corners in passing(rate_hz, 3.0, (-2.0, 3.0, 1.4), (1.5, 4.0, -0.5))
        if not 1_000_000 < stamp < 1_500_000
    ]
    assert tracks_of(frames) == [[-1, -1]] + [[1, 2]] * (len(frames) - 1)


def test_after_too_long_a_gap_a_person_gets_another_number() -> None:
    frames = [boxes(stamp, [seen_as(0, 3)]) for stamp in (0, 33_000, 66_000, 1_600_000, 1_633_000)]
    assert tracks_of(frames) == [[-1], [1], [1], [-1], [2]]


@pytest.mark.parametrize("rate_hz", [30.0, 15.0, 7.5])
def test_two_who_pass_and_hide_one_another_keep_their_numbers(rate_hz: float) -> None:
    """The one behind has no box while more than 0.7 of it is hidden, and a low score while 0.3 are."""
    frames, wanted = [], []
    for stamp, (near, far) in passing(rate_hz, 3.0, (-1.5, 2.0, 1.0), (2.4, 4.0, -1.2)):
        hidden = 1 - rectangle(*far).difference(rectangle(*near)).area / rectangle(*far).area
        if hidden > 0.7:
            frames.append(boxes(stamp, [near]))
            wanted.append([1])
        else:
            frames.append(boxes(stamp, [near, far], [0.97, 0.3 if hidden > 0.3 else 0.97]))
            wanted.append([1, 2])
    assert [1] in wanted
    wanted[0] = [-1, -1]
    assert tracks_of(frames) == wanted


def test_a_low_score_continues_a_track_and_begins_none() -> None:
    frames = [
        boxes(0, [seen_as(0, 3), seen_as(2, 3)], [0.97, 0.3]),
        boxes(33_000, [seen_as(0, 3), seen_as(2, 3)], [0.97, 0.3]),
        boxes(66_000, [seen_as(2, 3), seen_as(0.02, 3)], [0.3, 0.3]),
        boxes(99_000, [seen_as(0.04, 3)], 0.97),
    ]
    assert tracks_of(frames) == [[-1, -1], [1, -1], [-1, 1], [1]]


def test_a_box_goes_on_as_what_it_was() -> None:
    place = seen_as(0, 3)
    frames = [
        boxes(0, [place, place], label=("person", "dog")),
        boxes(33_000, [place, place], label=("person", "dog")),
        boxes(66_000, [place, place], label=("dog", "person")),
        boxes(99_000, [place], label=("cat",)),
        boxes(132_000, [place], label=("cat",)),
    ]
    _, first, second, _, third = tracks_of(frames)
    assert sorted(first) == [1, 2]
    assert second == first[::-1]
    assert third == [3]


def test_an_image_that_is_not_newer_is_ignored_and_counted() -> None:
    tracker = ImageTracker()
    tracker.step(boxes(100_000, [seen_as(0, 3)]))
    for stamp_us in (100_000, 50_000):
        assert tracker.step(boxes(stamp_us, [seen_as(0, 3)])).track.tolist() == [-1]
    assert tracker.late == 2
    assert tracker.step(boxes(133_000, [seen_as(0, 3)])).track.tolist() == [1]


def test_images_without_boxes_and_boxes_without_area() -> None:
    frames = [
        boxes(0, []),
        boxes(33_000, [[10, 10, 10, 50], [5, 5, 4, 9], seen_as(0, 3)]),
        boxes(66_000, [seen_as(0, 3)]),
        boxes(99_000, []),
        boxes(132_000, [seen_as(0, 3)]),
    ]
    assert tracks_of(frames) == [[], [-1, -1, -1], [1], [], [1]]


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_what_is_no_number_is_refused(broken: float) -> None:
    frame = boxes(0, [[0, 0, 5, broken]])
    with pytest.raises(InvalidInput, match="not finite"):
        ImageTracker().step(frame)
    with pytest.raises(InvalidInput, match="not finite"):
        ImageTracker().step(boxes(0, [[0, 0, 5, 5]], broken))


def test_another_cameras_boxes_are_refused() -> None:
    tracker = ImageTracker()
    tracker.step(boxes(0, [seen_as(0, 3)]))
    with pytest.raises(InvalidInput, match="came to the tracker of camera_optical"):
        tracker.step(replace(boxes(33_000, []), frame="other_optical"))


@given(seed=st.integers(0, 2**32 - 1), counts=st.lists(st.integers(0, 6), min_size=1, max_size=10))
@settings(max_examples=40, deadline=None)
def test_numbers_are_told_apart_and_do_not_depend_on_the_order_of_boxes(seed: int, counts: list[int]) -> None:
    random = np.random.default_rng(seed)
    one, other = ImageTracker(), ImageTracker()
    highest = 0
    low = random.uniform(0, 300, (6, 2))
    places = np.hstack([low, low + random.uniform(20, 200, (6, 2))])
    for frame, count in enumerate(counts):
        around = random.permutation(places)[:count] + random.uniform(-3, 3, (count, 4))
        made = boxes(33_000 * frame, around, random.uniform(0.2, 1, count))
        order = random.permutation(count)
        mixed = replace(made, corners_px=made.corners_px[order], score=made.score[order])
        track = one.step(made).track
        assert other.step(mixed).track.tolist() == track[order].tolist()
        numbers = track[track >= 0]
        assert len(set(numbers.tolist())) == len(numbers)
        new = np.sort(numbers[numbers > highest])
        assert new.tolist() == list(range(highest + 1, highest + 1 + len(new)))
        highest += len(new)
