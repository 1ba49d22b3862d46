"""What a map tracker finds out later: made mistakes, and scenes in which nothing is to be found."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from semap_ingest.sensing.detections import LASER, Detections
from semap_ingest.sensing.track_states import TrackAmendment, TrackStates
from walking_crowd import Crowd, Scene, detections, scene, tracked

PERIOD_US = 66_667


def amendments(states: list[TrackStates]) -> list[TrackAmendment]:
    return [one for each in states for one in each.amendments]


def two_on_one(images: tuple[int, int] = (-1, -1), both_at: tuple[int, ...] = ()) -> list[Detections]:
    """Two stand 0.5 m apart; from frame 20 on there is one person between them, whom each track takes in turn.

    both_at  frames in which there are two detections nevertheless
    """
    frames = [detections(frame * PERIOD_US, [[0.0, 0.0], [0.5, 0.0]], hint=images) for frame in range(20)]
    for frame in range(20, 70):
        if frame in both_at:
            frames.append(detections(frame * PERIOD_US, [[0.15, 0.0], [0.35, 0.0]], hint=images))
            continue
        side = frame % 2
        frames.append(detections(frame * PERIOD_US, [[0.15 + 0.2 * side, 0.0]], hint=images[side]))
    return frames


def test_two_tracks_on_one_person_turn_out_to_be_merged() -> None:
    states = tracked(two_on_one())
    (found,) = amendments(states)
    assert (found.kind, found.track, found.other) == ("merged", 2, 1)
    assert 20 * PERIOD_US <= found.since_us <= 40 * PERIOD_US
    assert found.since_us + 1_000_000 <= found.found_us <= found.since_us + 1_000_000 + PERIOD_US
    at = next(index for index, each in enumerate(states) if each.amendments)
    assert [number for number, _ in states[at].ended] == [2]
    assert states[-1].track.tolist() == [1]
    assert all(2 not in each.track for each in states[at:])


@pytest.mark.parametrize(
    "frames",
    [two_on_one(images=(1, 2)), two_on_one(both_at=(28, 36, 44, 52, 60))],
    ids=["images differ", "both seen"],
)
def test_two_persons_are_not_merged(frames: list[Detections]) -> None:
    assert amendments(tracked(frames)) == []


def hidden_for(seconds: float, image_after: int, away_m: float) -> list[Detections]:
    start_us = 30 * PERIOD_US + round(seconds * 1e6)
    before = [detections(frame * PERIOD_US, [[1.0, 0.0]], hint=7) for frame in range(31)]
    hidden = [detections(stamp, []) for stamp in range(31 * PERIOD_US, start_us, PERIOD_US)]
    after = [
        detections(start_us + frame * PERIOD_US, [[1.0 + away_m, 0.0]], hint=image_after)
        for frame in range(20)
    ]
    return [*before, *hidden, *after]


def test_who_comes_to_light_again_as_a_new_track_turns_out_to_be_who_it_was() -> None:
    frames = hidden_for(4.0, image_after=7, away_m=3.0)
    (found,) = amendments(tracked(frames))
    began_us = 30 * PERIOD_US + 4_000_000
    assert found == TrackAmendment("merged", 2, 1, began_us, found.found_us)
    assert began_us < found.found_us <= began_us + 5 * PERIOD_US


@pytest.mark.parametrize(
    ("seconds", "image_after", "away_m"), [(4.0, 8, 3.0), (4.0, 7, 9.0), (12.0, 7, 1.0), (4.0, -1, 0.5)]
)
def test_another_image_track_place_or_time_is_somebody_else(
    seconds: float, image_after: int, away_m: float
) -> None:
    states = tracked(hidden_for(seconds, image_after, away_m))
    assert (amendments(states), states[-1].track.tolist()) == ([], [2])


def bounce(images_after: tuple[int, int], unseen_s: float = 0.6) -> list[Detections]:
    """Two walk towards one another, meet where neither is seen, and go back the way they came; at first the laser
    alone sees them again, as if they had passed."""
    frames = []
    for frame in range(90):
        time_s = frame * PERIOD_US / 1e6
        distance_m = abs(time_s - 2.5) * 1.2
        stamp_us = frame * PERIOD_US
        where = [[-distance_m, 0.0], [distance_m, 0.0]]
        if abs(time_s - 2.5) < unseen_s / 2:
            frames.append(detections(stamp_us, []))
        elif time_s < 2.5:
            frames.append(detections(stamp_us, where, hint=[1, 2]))
        elif time_s < 3.2:
            frames.append(detections(stamp_us, where, seen_by=LASER))
        else:
            frames.append(detections(stamp_us, where, hint=images_after))
    return frames


def test_two_tracks_that_were_mistaken_turn_out_to_be_switched() -> None:
    states = tracked(bounce(images_after=(1, 2)))
    first, last = states[10], states[-1]
    assert (np.sign(first.position_m[:, 0]) == -np.sign(last.position_m[:, 0])).all(), "they were mistaken"
    (found,) = amendments(states)
    assert (found.kind, found.track, found.other) == ("switched", 2, 1)
    assert 3_200_000 <= found.since_us <= 3_200_000 + 2 * PERIOD_US
    assert found.since_us + 700_000 <= found.found_us <= found.since_us + 700_000 + PERIOD_US


def test_two_who_passed_are_not_said_to_be_switched() -> None:
    assert amendments(tracked(bounce(images_after=(2, 1)))) == []


def test_where_the_place_left_no_doubt_the_image_tracker_was_mistaken() -> None:
    frames = [
        detections(
            frame * PERIOD_US,
            [[0.8 * frame / 15, 0.0], [0.8 * frame / 15, 2.0]],
            hint=[1, 2] if frame < 40 else [2, 1],
        )
        for frame in range(90)
    ]
    states = tracked(frames)
    assert amendments(states) == []
    assert states[-1].position_m[:, 1].round(1).tolist() == [0.0, 2.0]


def test_images_that_swap_for_a_moment_say_nothing() -> None:
    frames = bounce(images_after=(1, 2))
    back = [
        replace(frame, hint=frame.hint[::-1]) if frame.stamp_us > 3_700_000 and len(frame) == 2 else frame
        for frame in frames
    ]
    assert amendments(tracked(back)) == []


def persons_of(
    number: int, made: Scene, states: list[TrackStates], begin_us: int, end_us: int
) -> Counter[int]:
    """In how many frames a track was nearest to whom."""
    near: Counter[int] = Counter()
    for frame, each in enumerate(states):
        if begin_us <= each.stamp_us < end_us and number in each.track:
            place = each.position_m[each.track == number][0]
            near[int(np.hypot(*(made.position_m[frame] - place).T).argmin())] += 1
    return near


def test_crossing_crowds_give_no_false_amendments() -> None:
    """Whom `track` follows after `since_us` is whom `other` followed before, and in a switch the other way round."""
    told = 0
    for seed in range(100, 103):
        made = scene(Crowd(people=8, seconds=20.0, hall_m=(6.0, 6.0)), seed)
        states = tracked(made.frames)
        for one in amendments(states):
            told += 1
            before = one.since_us - 2_000_000, one.since_us - 500_000
            after = one.since_us, one.since_us + 1_000_000
            ways = (
                [(one.track, one.other)]
                if one.kind == "merged"
                else [(one.track, one.other), (one.other, one.track)]
            )
            for here, there in ways:
                now, then = (
                    persons_of(here, made, states, *after),
                    persons_of(there, made, states, before[0] - 10_000_000, before[1]),
                )
                assert now.most_common(1)[0][0] in then, one
    assert told
