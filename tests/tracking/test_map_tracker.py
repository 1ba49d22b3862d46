"""The map tracker on scenes of a few detections, each with what must come of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
from semap_ingest.sensing.detections import BOTH, CAMERA, LASER, Detections, no_look
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.tracking.map_tracker import MapTracker, MapTrackerSettings
from semap_ingest.tracking.walking import Walking
from walking_crowd import Crowd, detections, scene, shuffled, tracked

from semap.errors import InvalidInput

PERIOD_US = 66_667


def frames_of(
    where: Callable[[float], object],
    seconds: float,
    period_us: int = PERIOD_US,
    start_us: int = 0,
    **how: object,
) -> list[Detections]:
    """What is at `where` (time in s), frame by frame."""
    stamps = range(start_us, start_us + round(seconds * 1e6), period_us)
    return [detections(stamp, where(stamp / 1e6), **how) for stamp in stamps]


def numbers(states: list[TrackStates]) -> list[list[int]]:
    return [each.track.tolist() for each in states]


@pytest.mark.parametrize(
    ("seen_by", "score", "frames_needed"),
    [
        (BOTH, 0.95, 2),
        (BOTH, 0.6, 4),
        (CAMERA, 0.6, 4),
        (LASER, 0.9, 19),
        (LASER, 0.6, None),
        (BOTH, 0.2, None),
    ],
)
def test_who_stands_is_believed_after_so_many_frames(
    seen_by: int, score: float, frames_needed: int | None
) -> None:
    states = tracked(frames_of(lambda _: [[1.0, 2.0]], 3.0, seen_by=seen_by, score=score))
    told = [index for index, each in enumerate(states) if len(each)]
    assert (told[0] + 1 if told else None) == frames_needed
    assert told == list(range(told[0], len(states)) if told else [])


@pytest.mark.parametrize("score", [0.85, 0.9, 0.95])
def test_belief_takes_seconds_and_not_frames(score: float) -> None:
    """Who stands before a laser is believed after about the same time at 5 to 40 Hz."""
    times_s = []
    for rate_hz in (5, 7.5, 15, 40):
        frames = frames_of(
            lambda _: [[1.0, 2.0]], 4.0, period_us=round(1e6 / rate_hz), seen_by=LASER, score=score
        )
        told = [frame.stamp_us for frame, each in zip(frames, tracked(frames), strict=True) if len(each)]
        times_s.append(told[0] / 1e6)
    assert max(times_s) - min(times_s) <= 0.25


@pytest.mark.parametrize("rate_hz", [5, 40])
def test_what_looks_a_little_like_a_leg_is_never_believed_however_long_it_stands(rate_hz: float) -> None:
    frames = frames_of(
        lambda _: [[1.0, 2.0]], 60.0, period_us=round(1e6 / rate_hz), seen_by=LASER, score=0.65
    )
    assert not any(numbers(tracked(frames)))


def test_a_laser_believes_who_walks_before_who_stands() -> None:
    states = tracked(frames_of(lambda t: [[1.2 * t, 0.0], [0.0, 5.0]], 2.0, seen_by=LASER, score=0.6))
    assert [each.position_m[:, 1].max(initial=0) > 2.5 for each in states] == [False] * len(states)
    assert numbers(states)[-1] == [1]


def test_clutter_that_comes_and_goes_is_never_believed() -> None:
    random = np.random.default_rng(5)
    frames = [
        detections(frame * PERIOD_US, random.uniform(0, 10, (3, 2)), seen_by=LASER, score=0.9)
        for frame in range(200)
    ]
    assert all(len(each) == 0 for each in tracked(frames))


def test_equal_to_one_filter_of_filterpy_for_one_person() -> None:
    random = np.random.default_rng(3)
    walking = Walking()
    stamps = np.cumsum(random.integers(20_000, 400_000, 40))
    frames = [detections(int(stamp), random.normal([1.1 * stamp / 1e6, 0.1], 0.05)) for stamp in stamps]
    oracle = KalmanFilter(dim_x=4, dim_z=2)
    oracle.H = np.eye(2, 4)
    oracle.x[:2, 0] = frames[0].position_m[0]
    first = 0.05**2 + walking.stance_std_m**2
    oracle.P = np.diag([first, first, walking.speed_std_mps**2, walking.speed_std_mps**2])
    states = tracked(frames)
    within = walking.first_frames
    for before, frame, told in zip(frames, frames[1:], states[1:], strict=False):
        step_s = (frame.stamp_us - before.stamp_us) / 1e6
        noise = Q_continuous_white_noise(2, step_s, walking.acceleration_density, 2, order_by_dim=False)
        oracle.predict(F=np.kron([[1, step_s], [0, 1]], np.eye(2)), Q=noise)
        velocity = oracle.x[2:] / max(walking.full_stride_mps, np.linalg.norm(oracle.x[2:]))
        sway = walking.stance_std_m**2 * np.eye(2) + walking.sway_std_m**2 * velocity @ velocity.T
        within = 1.0 + within * max(0.0, 1.0 - step_s / walking.sway_time_s)
        sway *= within
        oracle.update(frame.position_m[0][:, None], R=0.05**2 * np.eye(2) + sway)
        np.testing.assert_allclose(told.position_m[0], oracle.x[:2, 0], rtol=1e-9)
        np.testing.assert_allclose(told.velocity_mps[0], oracle.x[2:, 0], rtol=1e-9)
        np.testing.assert_allclose(told.covariance_m2[0], oracle.P[:2, :2], rtol=1e-9)


def test_heading_is_that_of_walking_and_stays_when_standing() -> None:
    def way(time_s: float) -> list[list[float]]:
        walked_s = np.clip(time_s - 1.0, 0.0, 2.0)
        return [[1.0, 1.0 - 1.2 * walked_s]]

    random = np.random.default_rng(1)
    frames = [
        replace(frame, position_m=frame.position_m + random.normal(0, 0.03, (1, 2)))
        for frame in frames_of(way, 6.0)
    ]
    states = tracked(frames)
    heading = np.array([each.heading_rad[0] if len(each) else np.nan for each in states])
    time_s = np.array([each.stamp_us for each in states]) / 1e6
    assert np.isnan(heading[time_s < 1.0]).all()
    assert np.abs(heading[time_s > 2.0] + np.pi / 2).max() < 0.2
    assert (heading[time_s > 4.5] == heading[-1]).all()


def test_who_is_hidden_for_a_while_goes_on_and_is_not_guessed_meanwhile() -> None:
    frames = frames_of(lambda t: [[1.2 * t, 0.0]] if not 2.0 < t < 3.3 else [], 5.0)
    states = tracked(frames)
    assert numbers(states)[2:] == [[1] if len(frame) else [] for frame in frames[2:]]
    assert all(not each.ended for each in states)


@pytest.mark.parametrize(("image_after", "track_after"), [(7, 1), (8, 2)])
def test_after_longer_only_the_image_track_tells_who_it_is(image_after: int, track_after: int) -> None:
    before = frames_of(lambda _: [[2.0, 0.0]], 2.0, hint=7)
    hidden = frames_of(lambda _: [], 2.2, start_us=before[-1].stamp_us + PERIOD_US)
    after = frames_of(lambda _: [[2.3, 0.0]], 1.0, start_us=hidden[-1].stamp_us + PERIOD_US, hint=image_after)
    states = tracked([*before, *hidden, *after])
    assert numbers(states)[-1] == [track_after]


@dataclass(frozen=True)
class UpTo:
    """Sight of a sensor that sees what is nearer than so much along x."""

    x_m: float

    def reaches(self, position_m: np.ndarray) -> np.ndarray:
        return position_m[:, 0] < self.x_m


def out_of_sight(where: Callable[[float], object], away_s: float) -> list[list[int]]:
    """Numbers at the end of those who are seen again after a sensor has looked elsewhere for so long."""
    before = frames_of(where, 2.0)
    away = frames_of(lambda _: [], away_s, start_us=before[-1].stamp_us + PERIOD_US)
    after = frames_of(where, 2.0, start_us=away[-1].stamp_us + PERIOD_US)
    states = tracked([*before, *(replace(each, sight=UpTo(1.0)) for each in away), *after])
    return [sorted({n for each in states for n in each.track.tolist()}), states[-1].track.tolist()]


@pytest.mark.parametrize("away_s", [2.0, 8.0, 14.0])
def test_who_stands_out_of_sight_is_the_same_when_seen_again(away_s: float) -> None:
    assert out_of_sight(lambda _: [[2.0, 0.0], [3.0, 1.0]], away_s) == [[1, 2], [1, 2]]


def test_who_walks_out_of_sight_or_stands_there_for_longer_is_somebody_else() -> None:
    assert out_of_sight(lambda t: [[2.0 + 0.6 * t, 0.0]], 8.0) == [[1, 2], [2]]
    assert out_of_sight(lambda _: [[2.0, 0.0]], 17.0) == [[1, 2], [2]]


def test_who_stood_elsewhere_when_seen_again_is_somebody_else() -> None:
    assert out_of_sight(lambda t: [[2.0 if t < 4.0 else 3.0, 0.0]], 8.0) == [[1, 2], [2]]


def test_where_no_sensor_looks_any_more_who_stands_is_over_as_well() -> None:
    before = frames_of(lambda _: [[2.0, 0.0]], 2.0)
    states = tracked([*before, no_look(before[-1].stamp_us + 1_600_000, "map")])
    assert [number for number, _ in states[-1].ended] == [1]


def test_a_track_that_is_over_is_told_once_with_when_it_was_last_seen() -> None:
    frames = frames_of(lambda t: [[1.0, 1.0]] if t < 1.0 else [], 4.0)
    states = tracked(frames)
    last_us = max(frame.stamp_us for frame in frames if len(frame))
    ends = [(each.stamp_us, each.ended) for each in states if each.ended]
    assert [ended for _, ended in ends] == [((1, last_us),)]
    assert 1_500_000 < ends[0][0] - last_us < 1_500_000 + 2 * PERIOD_US


def test_the_end_of_a_recording_ends_all_tracks() -> None:
    tracker = MapTracker()
    states = tracked(frames_of(lambda _: [[1.0, 1.0], [4.0, 1.0]], 1.0), tracker)
    assert tracker.finish().ended == ((1, states[-1].stamp_us), (2, states[-1].stamp_us))
    assert tracker.finish().ended == ()
    assert MapTracker().finish().ended == ()


@pytest.mark.parametrize("period_us", [33_333, 66_667, 133_333])
@pytest.mark.parametrize("with_images", [True, False])
def test_two_who_pass_closely_keep_their_numbers(period_us: int, with_images: bool) -> None:
    random = np.random.default_rng(7)
    for _ in range(2):
        frames = frames_of(
            lambda t: np.array([[1.2 * t, 0.0], [6.0 - 1.2 * t, 0.6]]) + random.normal(0, 0.05, (2, 2)),
            5.0,
            period_us,
            hint=[1, 2] if with_images else -1,
        )
        states = tracked(frames)
        assert states[-1].track.tolist() == [1, 2]
        number_one = states[-1].position_m[0]
        began = states[1].position_m[0]
        assert abs(number_one[1] - began[1]) < 0.3, "the one at y = 0 is at y = 0 again"


@pytest.mark.parametrize("side_m", [-0.25, 0.0, 0.25])
def test_two_who_are_one_detection_for_a_second_part_as_their_images_tell(side_m: float) -> None:
    """They walk side by side, come together, and part again, where constant velocity would have them cross; one box
    and one pair of legs for a second."""
    frames = []
    for frame in range(90):
        stamp_us, time_s = frame * PERIOD_US, frame * PERIOD_US / 1e6
        x, y = 0.8 * time_s, 0.8 * min(max(abs(time_s - 3.0) - 0.5, 0.0), 1.0)
        where, images = ([[x, y], [x, -y]], [1, 2]) if y else ([[x, side_m]], 1)
        frames.append(detections(stamp_us, where, hint=images))
    states = tracked(frames)
    first, last = states[1], states[-1]
    assert first.track.tolist() == last.track.tolist() == [1, 2]
    assert (np.sign(last.position_m[:, 1]) == np.sign(first.position_m[:, 1])).all()
    assert {number for each in states for number in each.track.tolist()} == {1, 2}


def test_a_frame_that_is_not_newer_is_ignored_and_counted() -> None:
    frames = frames_of(lambda t: [[1.2 * t, 0.0]], 2.0)
    tracker, other = MapTracker(), MapTracker()
    for frame in frames:
        told, wanted = tracker.step(frame), other.step(frame)
        assert np.array_equal(told.position_m, wanted.position_m)
        for late_us in (frame.stamp_us, frame.stamp_us - 10_000):
            late = tracker.step(detections(late_us, [[3.0, 3.0]]))
            assert (len(late), late.ended, late.amendments) == (0, (), ())
    assert (tracker.late, other.late) == (2 * len(frames), 0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("covariance_m2", np.full((1, 2, 2), np.nan)),
        ("covariance_m2", np.array([[[1.0, 2.0], [2.0, 1.0]]])),
        ("covariance_m2", np.array([[[1.0, 0.5], [0.0, 1.0]]])),
        ("covariance_m2", -np.eye(2)[None]),
        ("covariance_m2", np.eye(2)),
        ("position_m", np.array([[np.nan, 0.0]])),
        ("position_m", np.array([[np.inf, 0.0]])),
        ("score", np.array([np.nan])),
        ("score", np.array([1.5])),
        ("hint", np.array([1, 2])),
    ],
)
def test_what_no_filter_can_take_is_refused_and_changes_nothing(field: str, value: np.ndarray) -> None:
    tracker = MapTracker()
    frames = frames_of(lambda _: [[1.0, 1.0]], 1.0)
    before = tracked(frames[:-1], tracker)
    with pytest.raises(InvalidInput, match="detections in map at"):
        tracker.step(replace(frames[-1], **{field: value}))
    assert tracker.step(frames[-1]).track.tolist() == before[-1].track.tolist() == [1]


def test_another_frame_of_reference_is_refused() -> None:
    tracker = MapTracker()
    tracker.step(detections(0, [[1, 1]]))
    with pytest.raises(InvalidInput, match="detections in odom came to the tracker of map"):
        tracker.step(detections(1, [[1, 1]], frame="odom"))


def test_frames_without_anybody_and_gaps_of_seconds() -> None:
    tracker = MapTracker()
    assert len(tracker.step(detections(-5, []))) == 0
    states = tracked([detections(stamp, [[0, 0]]) for stamp in range(0, 20_000_000, 1_000_000)], tracker)
    assert {number for each in states for number in each.track.tolist()} == {1}
    assert tracker.step(detections(3_600_000_000, [[0, 0]])).ended == ((1, 19_000_000),)


def test_an_exact_detection_and_one_that_knows_nothing() -> None:
    exact = tracked(frames_of(lambda t: [[t, 0.0]], 2.0, std_m=0.0))
    vague = tracked(frames_of(lambda t: [[t, 0.0]], 2.0, std_m=1e4))
    assert numbers(exact)[-1] == [1]
    assert all(np.isfinite(each.covariance_m2).all() for each in [*exact, *vague])


def test_extent_goes_from_the_prior_to_what_is_measured() -> None:
    frames = frames_of(lambda _: [[1.0, 1.0], [4.0, 1.0]], 10.0)
    measured = np.array([[np.nan, np.nan], [0.5, 9.0]])
    states = tracked([replace(frame, extent_m=measured) for frame in frames])
    np.testing.assert_allclose(states[1].extent_m[0], [0.35, 0.5])
    np.testing.assert_allclose(states[-1].extent_m[0], [0.35, 0.5])
    np.testing.assert_allclose(states[-1].extent_m[1], [0.5, 1.0], atol=0.05)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None)
def test_the_order_of_detections_does_not_matter(seed: int) -> None:
    frames = scene(Crowd(people=6, seconds=4.0, hall_m=(5.0, 5.0), clutter=1.0), seed).frames
    random = np.random.default_rng(seed)
    mixed = [shuffled(frame, random.permutation(len(frame))) for frame in frames]
    for one, other in zip(tracked(frames), tracked(mixed), strict=True):
        for name in ("track", "position_m", "velocity_mps", "covariance_m2", "extent_m", "heading_rad"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        assert (one.ended, one.amendments) == (other.ended, other.amendments)


@given(seed=st.integers(0, 2**32 - 1), gaps=st.lists(st.integers(1, 4_000_000), min_size=1, max_size=40))
@settings(max_examples=30, deadline=None)
def test_what_every_sequence_of_frames_keeps_to(seed: int, gaps: list[int]) -> None:
    """New numbers count on; a track that ended is never told again; who is told was detected in this frame."""
    random = np.random.default_rng(seed)
    tracker, highest, over, last_us = MapTracker(), 0, set(), {}
    for stamp_us in np.cumsum(gaps).tolist():
        frame = detections(
            stamp_us,
            random.choice([0.0, 0.4, 0.9, 3.0], (random.integers(0, 5), 2)),
            score=0.9,
            hint=random.integers(-1, 4),
        )
        told = tracker.step(frame)
        fresh = [number for number in told.track.tolist() if number not in last_us]
        assert fresh == list(range(highest + 1, highest + 1 + len(fresh)))
        highest += len(fresh)
        assert len(told) <= len(frame)
        assert not over & set(told.track.tolist())
        last_us |= dict.fromkeys(told.track.tolist(), stamp_us)
        for number, seen_us in told.ended:
            assert number not in over
            assert last_us[number] == seen_us or any(one.track == number for one in told.amendments)
            over.add(number)
        assert (np.linalg.eigvalsh(told.covariance_m2) > 0).all()
    assert over | {number for number, _ in tracker.finish().ended} == set(range(1, highest + 1))


def test_settings_of_a_role_are_used() -> None:
    quick = MapTrackerSettings(existence=replace(MapTrackerSettings().existence, believed=0.7))
    frames = frames_of(lambda _: [[0, 0]], 0.2, score=0.6)
    assert numbers(tracked(frames)) == [[], [], []]
    assert numbers(tracked(frames, MapTracker(quick)))[1:] == [[1], [1]]
