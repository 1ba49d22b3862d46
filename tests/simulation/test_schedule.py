"""The course of events: what must hold at each moment of it, for any seed."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from semap_ingest.simulation.crowd import APART_M
from semap_ingest.simulation.floor import HALLWAY
from semap_ingest.simulation.motion import STEP_S
from semap_ingest.simulation.person import body_outlines
from semap_ingest.simulation.schedule import Moments, moments, wanted_passages
from semap_ingest.simulation.settings import Gap, OfficeSettings
from simulated import SEEDS, course

from semap.errors import InvalidInput

EVERY = 5
"""Samples between two looks: a twentieth of a second."""


@pytest.fixture(params=SEEDS)
def happening(request: pytest.FixtureRequest) -> Moments:
    return course(request.param)


def test_counts(happening: Moments) -> None:
    by_hand = [passage for passage in happening.passages if passage.opening_s]
    assert len(happening.passages) == 16
    assert len(by_hand) == 6
    assert [move.to_rad > move.from_rad for move in happening.moves].count(True) == 6
    assert len(happening.moves) == 12


def test_a_door_is_opened_before_and_closed_after_by_the_same_person(happening: Moments) -> None:
    for passage in happening.passages:
        if passage.opening_s and passage.closing_s:
            (opens_s, open_s), (closes_s, closed_s) = passage.opening_s, passage.closing_s
            assert 1.0 <= open_s - opens_s <= 1.6
            assert 1.0 <= closed_s - closes_s <= 1.6
            assert (
                passage.start_s < opens_s < open_s < passage.complete_s < closes_s < closed_s < passage.end_s
            )
            assert closed_s - passage.complete_s < 4.5
        else:
            assert passage.door.hinge is None or passage.door.name in happening.standing_rad


def test_doors_turn_one_at_a_time_and_smoothly(happening: Moments) -> None:
    times = np.arange(0, 93, 0.01)
    for door in happening.floor.leaf_doors:
        moves = [move for move in happening.moves if move.door == door.name]
        assert all(first.end_s < second.start_s for first, second in pairwise(moves))
        angles = np.array([happening.door_rad(time_s)[door.name] for time_s in times[::10]])
        assert angles.min() >= 0
        assert np.degrees(angles.max()) <= 96
        assert np.abs(np.diff(angles)).max() / 0.1 < 1.875 * np.radians(96) / 1.0
        if door.name in happening.standing_rad:
            assert (angles == happening.standing_rad[door.name]).all()
            assert not moves


def test_bodies_keep_clear_of_walls(happening: Moments) -> None:
    free = happening.floor.free
    shapely.prepare(free)
    for person in happening.people:
        motion = person.motion
        bodies = body_outlines(
            motion.position_m[::EVERY], motion.heading_rad[::EVERY], person.width_m, person.depth_m
        )
        assert shapely.covers(free, bodies).all()


def test_bodies_keep_clear_of_leaves_and_furniture(happening: Moments) -> None:
    things = [thing.footprint for thing in happening.floor.things]
    for person in happening.people:
        motion = person.motion
        bodies = body_outlines(
            motion.position_m[::EVERY], motion.heading_rad[::EVERY], person.width_m, person.depth_m
        )
        near = shapely.STRtree(bodies)
        assert not len(near.query(things, predicate="intersects")[0])
        for door in happening.floor.leaf_doors:
            hinge = shapely.Point(door.leaf_m(0.0)[0])
            for index in near.query(hinge, predicate="dwithin", distance=door.width_m):
                angle = happening.door_rad(index * EVERY * STEP_S)[door.name]
                leaf = shapely.LineString(door.leaf_m(angle))
                assert not bodies[index].intersects(leaf), (person.name, door.name, index * EVERY * STEP_S)


@pytest.mark.parametrize(("seed", "people"), [(1, 5), (8, 5), (3, 20)])
def test_persons_keep_apart(seed: int, people: int) -> None:
    everybody = np.array([person.motion.position_m for person in course(seed, people).people])
    for index, own in enumerate(everybody):
        apart_m = np.linalg.norm(everybody[index + 1 :] - own, axis=-1)
        assert not apart_m.size or apart_m.min() > APART_M - 0.1


def test_nobody_jumps_or_runs(happening: Moments) -> None:
    for person in happening.people:
        step_m = np.linalg.norm(np.diff(person.motion.position_m, axis=0), axis=1)
        step_rad = np.abs(np.diff(person.motion.heading_rad))
        assert step_m.max() / STEP_S < 1.4
        assert step_rad.max() / STEP_S < 3.0
        assert np.abs(np.diff(step_m)).max() / STEP_S**2 < 3.0
        if step_m.any():
            assert step_m.max() / STEP_S > 0.8


def test_people_differ_in_size_within_bounds(happening: Moments) -> None:
    for person in happening.people:
        assert 0.45 <= person.width_m <= 0.55
        assert 0.25 <= person.depth_m <= 0.35
        assert 0.05 <= person.shin_radius_m <= 0.07
        assert person.clothes.shape == (4, 3)


def test_same_settings_same_course_other_seed_another() -> None:
    again, other = moments(OfficeSettings(seed=1)), course(8)
    for first, second in zip(course(1).people, again.people, strict=True):
        assert (first.motion.position_m == second.motion.position_m).all()
        assert (first.clothes == second.clothes).all()
    assert course(1).moves == again.moves
    assert [each.door.name for each in again.passages] != [each.door.name for each in other.passages]


def test_what_the_sensors_look_like_changes_nothing() -> None:
    bare = moments(replace(OfficeSettings(seed=1), camera=False, cloud=True, gaps=(Gap("laser", 1, 2),)))
    assert bare.moves == course(1).moves


def test_a_moment_between_samples_lies_between_them(happening: Moments) -> None:
    for time_s in (10.0, 41.37, 92.99):
        before, middle, after = (happening.at(time_s + step) for step in (0.0, 0.005, 0.01))
        for body, first, last in zip(middle.bodies, before.bodies, after.bodies, strict=True):
            assert body.position_m == pytest.approx((first.position_m + last.position_m) / 2, abs=1e-9)
            assert body.shins_m == pytest.approx((first.shins_m + last.shins_m) / 2, abs=1e-9)


def test_before_the_beginning_and_after_the_end_all_stand(happening: Moments) -> None:
    assert (happening.at(-5).bodies[0].position_m == happening.at(0).bodies[0].position_m).all()
    assert (happening.at(1e6).bodies[0].position_m == happening.at(94).bodies[0].position_m).all()


def test_crowd_has_the_same_passages_and_wanderers() -> None:
    crowd = course(3, 20)
    assert len(crowd.people) == 20
    assert len({person.name for person in crowd.people}) == 20
    assert (len(crowd.passages), len(crowd.moves)) == (16, 12)
    actors = {passage.person for passage in crowd.passages}
    assert actors <= {person.name for person in crowd.people[:6]}
    strolled = [np.ptp(person.motion.position_m, axis=0).max() > 1 for person in crowd.people[6:]]
    assert sum(strolled) > 7


@pytest.mark.parametrize(
    ("people", "duration_s", "wanted"),
    [
        (5, 93, (16, 6)),
        (4, 93, (16, 6)),
        (20, 200, (16, 6)),
        (2, 93, (8, 3)),
        (5, 46.5, (8, 3)),
        (1, 1, (0, 0)),
    ],
)
def test_fewer_people_or_less_time_means_fewer_passages(
    people: int, duration_s: float, wanted: tuple[int, int]
) -> None:
    assert wanted_passages(OfficeSettings(people=people, duration_s=duration_s)) == wanted


@pytest.mark.parametrize(("people", "duration_s"), [(1, 93.0), (5, 30.0), (6, 1.0)])
def test_small_settings_are_kept(people: int, duration_s: float) -> None:
    settings = OfficeSettings(seed=4, people=people, duration_s=duration_s)
    found = moments(settings)
    assert (len(found.passages), len(found.moves) // 2) == wanted_passages(settings)


def test_people_are_where_the_passages_say(happening: Moments) -> None:
    """Just before it begins and when it has ended, by the middle of the body."""
    people = {person.name: person for person in happening.people}
    for passage in happening.passages:
        position_m = people[passage.person].motion.position_m
        begins, ends = (position_m[round(time_s / STEP_S)] for time_s in (passage.start_s, passage.end_s))
        rooms = (HALLWAY, passage.door.room) if passage.kind == "entered" else (passage.door.room, HALLWAY)
        assert happening.floor.rooms[rooms[0]].contains(shapely.Point(begins))
        assert happening.floor.rooms[rooms[1]].contains(shapely.Point(ends))


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({"people": 0}, "0 people"),
        ({"people": 21}, "21 people"),
        ({"seed": -1}, "seed of -1"),
        ({"duration_s": 0.5}, "0.5 s"),
        ({"duration_s": float("nan")}, "nan s"),
        ({"duration_s": float("inf")}, "inf s"),
    ],
)
def test_settings_that_cannot_be(fields: dict[str, float], says: str) -> None:
    with pytest.raises(InvalidInput, match=says):
        OfficeSettings(**fields)


@pytest.mark.parametrize(
    "text", ["", "camera", "camera:1", "lidar:1:2", "camera:a:2", "laser:1:0", "laser:nan:1"]
)
def test_gaps_that_cannot_be(text: str) -> None:
    with pytest.raises(InvalidInput, match="is no gap"):
        Gap.parse(text)


def test_gap() -> None:
    gap = Gap.parse("camera:20:2.5")
    assert gap == Gap("camera", 20.0, 2.5)
    assert [gap.covers(time_s) for time_s in (19.9, 20.0, 22.4, 22.5)] == [False, True, True, False]
