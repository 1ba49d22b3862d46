"""Visits by the exact edge against a fine walk along the same way."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from semap.batch.crossing import Area, Path, Visit, visits

ROOM = shapely.Polygon([(0, 0), (6, 0), (6, 4), (3, 4), (3, 1), (2, 1), (2, 4), (0, 4)])
STEP_US = 1_000_000
STD_M = 0.0
"""Exactly known, so that each excursion tells."""


def path(*tracks, ends: bool = True, z_m=None) -> Path:
    """Tracks as lists of points, one each second from 0 on, in one piece each."""
    points = np.array([point for track in tracks for point in track], float)
    number = np.repeat(np.arange(len(tracks)), [len(track) for track in tracks])
    first = np.concatenate([[True], np.diff(number) != 0])
    last = np.concatenate([first[1:], [True]])
    stamps = np.concatenate([np.arange(len(track)) * STEP_US for track in tracks])
    heights = np.full(len(points), np.nan) if z_m is None else np.array(z_m, float)
    return Path(number, stamps, points, np.full(len(points), STD_M), heights, number, last & ends, first)


def area(shape=ROOM, low=-np.inf, high=np.inf) -> Area:
    return Area(7, shape, low, high)


def test_the_edge_is_crossed_between_two_states() -> None:
    walk = path([(-1, 2), (1, 2), (2.5, 2), (2.5, -2)])
    assert list(visits(walk, [area()])) == [Visit(0, 7, 500_000, "moved", 1_666_666, "moved")]


def test_appears_disappears_and_stays() -> None:
    assert list(visits(path([(1, 1), (1, 2)]), [area()])) == [
        Visit(0, 7, 0, "appeared", STEP_US, "disappeared")
    ]
    assert list(visits(path([(1, 1), (1, 2)], ends=False), [area()])) == [
        Visit(0, 7, 0, "appeared", None, None)
    ]
    stays = path([(1, 1), (1, 2)], ends=False)
    stays.is_first[0] = False
    assert list(visits(stays, [area()])) == [Visit(0, 7, 0, None, None, None)]


def test_across_a_pause_the_first_state_that_shows_it_counts() -> None:
    walk = path([(-1, 2), (1, 2), (-1, 2)])
    parted = replace(walk, piece=np.array([0, 1, 2]))
    assert list(visits(parted, [area()])) == [Visit(0, 7, STEP_US, "moved", 2 * STEP_US, "moved")]


def test_an_excursion_within_the_standard_deviation_says_nothing() -> None:
    stays = path([(1, 1), (0.2, 1), (-0.05, 1), (-0.08, 1), (0.2, 1), (1, 1)])
    passes = path([(-1, 1), (-0.2, 1), (0.05, 1), (0.08, 1), (-0.2, 1), (-1, 1)])
    assert len(list(visits(stays, [area()]))) == 2
    assert len(list(visits(passes, [area()]))) == 1
    stays, passes = (replace(each, std_m=np.full(6, 0.1)) for each in (stays, passes))
    assert list(visits(stays, [area()])) == [Visit(0, 7, 0, "appeared", 5 * STEP_US, "disappeared")]
    assert list(visits(passes, [area()])) == []
    # across a pause nothing is known of the way
    parted = replace(stays, piece=np.array([0, 0, 0, 1, 1, 1]))
    assert len(list(visits(parted, [area()]))) == 2


def test_climbing_stairs_leaves_the_storey_at_its_height() -> None:
    walk = path([(1, 1), (1.2, 1), (1.4, 1)], z_m=[0, 1, 4], ends=False)
    assert list(visits(walk, [area(low=0, high=3)])) == [Visit(0, 7, 0, "appeared", 1_666_666, "moved")]
    assert list(visits(walk, [area(low=3, high=6)])) == [Visit(0, 7, 1_666_667, "moved", None, None)]


@settings(max_examples=60, deadline=None)
@example([(1.0, 1.0), (0.0, 0.0), (1.0, 1.0)], 1)
@given(st.lists(st.tuples(st.floats(-1, 7), st.floats(-1, 5)), min_size=2, max_size=8), st.integers(1, 3))
def test_states_inside_are_in_a_visit_and_its_ends_lie_on_the_edge(points: list, count: int) -> None:
    walk = path(*[points[n:] + points[:n] for n in range(count)])
    found = list(visits(walk, [area()]))
    for track in range(count):
        of_track = walk.track == track
        stamps, places = walk.stamp_us[of_track], walk.position_m[of_track]
        held = [visit for visit in found if visit.track == track]
        for stamp, place in zip(stamps.tolist(), places, strict=True):
            inside = ROOM.contains(shapely.Point(place))
            covering = [
                v for v in held if v.began_us <= stamp <= (v.ended_us if v.ended_us is not None else stamp)
            ]
            assert len(covering) == 1 if inside else all(stamp in (v.began_us, v.ended_us) for v in covering)
        for visit in held:
            for stamp, cause in ((visit.began_us, visit.began_by), (visit.ended_us, visit.ended_by)):
                if cause == "moved":
                    at = np.array([np.interp(stamp, stamps, places[:, axis]) for axis in range(2)])
                    assert ROOM.boundary.distance(shapely.Point(at)) < 2e-5
        assert held == sorted(held, key=lambda visit: visit.began_us)
        for one, other in pairwise(held):
            assert one.ended_us is not None
            assert one.ended_us <= other.began_us
