"""A map at a moment, against what plain Python makes of the same states."""

from __future__ import annotations

import random
from collections.abc import Iterator
from itertools import pairwise

import pytest
import shapely
from sqlalchemy import Connection
from world import SECOND_US, World

from semap.store.database.connection import open_engine
from semap.store.motion import moment
from semap.timeline.stamp import to_datetime, to_us

ROOMS = {"west": shapely.box(0, 0, 4, 4), "east": shapely.box(4, 0, 8, 4), "both": shapely.box(1, 1, 7, 3)}
START_US = 1_769_860_800 * SECOND_US


@pytest.fixture
def reading(database: str) -> Iterator[Connection]:
    engine = open_engine(database)
    with engine.connect() as connection:
        yield connection
    engine.dispose()


class Story:
    """Tracks that wander through rooms, end, and come back."""

    def __init__(self, world: World, seed: int) -> None:
        chance = random.Random(seed)
        self.world = world
        self.rooms = {world.add_room(name, shape): shape for name, shape in ROOMS.items()}
        self.states: dict[int, list[tuple[int, float, float, bool]]] = {}
        for name in "abcdef":
            stamp_us, states = START_US + chance.randrange(20) * SECOND_US, []
            for _ in range(60):
                stamp_us += chance.choice([1, 1, 1, 2, 15]) * SECOND_US // 2
                place = (chance.uniform(-2, 10), chance.uniform(-2, 6))
                states.append((stamp_us, *place, chance.random() < 0.1))
            self.states[world.add_track(name)] = states
        together = sorted(
            (stamp_us, track_id, x_m, y_m, is_last)
            for track_id, states in self.states.items()
            for stamp_us, x_m, y_m, is_last in states
        )
        for stamp_us, track_id, x_m, y_m, is_last in together:
            world.add_states([(track_id, stamp_us, x_m, y_m, None, is_last)])

    def rooms_of(self, state: tuple[int, float, float, bool]) -> set[int]:
        _, x_m, y_m, is_last = state
        return (
            set()
            if is_last
            else {id_ for id_, shape in self.rooms.items() if shape.contains(shapely.Point(x_m, y_m))}
        )

    def at(self, at_us: int) -> dict[int, tuple[int, float, float, tuple[int, ...]]]:
        """Of each track that is there: when and where it was seen last, and its rooms."""
        there = {}
        for track_id, states in self.states.items():
            known = [each for each in states if each[0] <= at_us]
            if not known or known[-1][3]:
                continue
            rooms = self.rooms_of(known[-1])
            if rooms or known[-1][0] >= at_us - 10 * SECOND_US:
                there[track_id] = (*known[-1][:3], tuple(sorted(rooms)))
        return there

    def stays(self) -> set[tuple[int, int, int, int | None]]:
        """Track, room, since and until [us] of every stay."""
        found: set[tuple[int, int, int, int | None]] = set()
        for track_id, states in self.states.items():
            for room in self.rooms:
                since = None
                for state in states:
                    inside = room in self.rooms_of(state)
                    if since is None and inside:
                        since = state[0]
                    elif since is not None and not inside:
                        found.add((track_id, room, since, state[0]))
                        since = None
                if since is not None:
                    found.add((track_id, room, since, None))
        return found


@pytest.mark.parametrize("seed", [1, 2])
def test_a_moment_is_what_the_states_say(world: World, reading: Connection, seed: int):
    story = Story(world, seed)
    stamps = sorted(state[0] for states in story.states.values() for state in states)
    asked = [
        stamps[0] - 1,
        *stamps[::23],
        *(stamp + 1 for stamp in stamps[::31]),
        stamps[-1],
        stamps[-1] + 10**9,
    ]
    for at_us in asked:
        then = moment.moment(reading, world.name, to_datetime(at_us), trail_s=4)
        expected = story.at(at_us)
        assert {
            each.track_id: (to_us(each.stamp), each.x_m, each.y_m, each.rooms) for each in then.tracks
        } == expected
        counts: dict[int, int] = {}
        for *_, rooms in expected.values():
            for room in rooms:
                counts[room] = counts.get(room, 0) + 1
        assert then.occupants == counts
        for each in then.tracks:
            trail = [
                [x_m, y_m, (stamp_us - at_us) / SECOND_US]
                for stamp_us, x_m, y_m, _ in story.states[each.track_id]
                if at_us - 4 * SECOND_US <= stamp_us <= at_us
            ]
            assert each.trail == [pytest.approx(point, abs=1e-9) for point in trail]


def test_stays_are_what_the_states_say(world: World, reading: Connection):
    story = Story(world, 3)
    stamps = sorted(state[0] for states in story.states.values() for state in states)
    everything = story.stays()
    for start, end in [(stamps[0], stamps[-1]), *pairwise(stamps[::40]), (stamps[9], stamps[9])]:
        found = moment.stays(reading, world.name, to_datetime(start), to_datetime(end), 10_000)
        got = {
            (
                each.track_id,
                each.instance_id,
                to_us(each.since),
                None if each.until is None else to_us(each.until),
            )
            for each in found
        }
        assert got == {s for s in everything if s[2] <= end and (s[3] is None or s[3] > start)}
        assert len(got) == len(found)
        assert [each.since for each in found] == sorted(each.since for each in found)
    first, last = moment.extent(reading, world.name)
    assert (to_us(first), to_us(last)) == (stamps[0], stamps[-1])


def test_the_extent_of_a_map_that_began_long_after_another(world: World, reading: Connection):
    other = World(world.dsn, "other")
    assert moment.extent(reading, "other") is None
    late = other.add_track("late")
    track = world.add_track("early")
    world.add_states([(track, START_US + n * SECOND_US, 0, 0, None) for n in range(200)])
    other.add_states([(late, START_US + n * SECOND_US, 0, 0, None) for n in range(500, 510)])
    reading.rollback()
    found = [moment.extent(reading, name) for name in ("other", world.name)]
    assert [tuple(to_us(each) for each in span) for span in found] == [
        (START_US + 500 * SECOND_US, START_US + 509 * SECOND_US),
        (START_US, START_US + 199 * SECOND_US),
    ]
    other.close()


def test_a_long_trail_is_thinned_out(world: World, reading: Connection):
    track = world.add_track("fast")
    world.add_states([(track, START_US + n * 20_000, n, 0, None) for n in range(1500)])
    (there,) = moment.moment(reading, world.name, to_datetime(START_US + 1499 * 20_000), trail_s=60).tracks
    assert there.x_m == 1499
    assert [point[0] for point in there.trail] == [n for n in range(1500) if (1499 - n) % 8 == 0]


def test_doors_stand_as_they_were_told(world: World, reading: Connection):
    world.run("insert into semap.concept (name) values ('Door') on conflict do nothing")
    door_id = world.one(
        "insert into semap.instance (map_id, uid, name, concept_id, frame_id)"
        " select %s, gen_random_uuid(), 'door', concept_id, %s from semap.concept where name = 'Door' returning instance_id",
        world.map_id,
        world.frame_id,
    )
    told = [(10, "closed"), (20, "open"), (25, "open"), (30, "closing"), (31, "closed"), (40, "open")]
    for second, value in told:
        world.run(
            "insert into semap.object_state (source_id, instance_id, property, value, stamp) values (%s, %s, 'door', %s, %s)",
            world.source_id,
            door_id,
            value,
            to_datetime(START_US + second * SECOND_US),
        )
    truth = [
        ("closed", 10, 20),
        ("open", 20, 30),
        ("closing", 30, 31),
        ("closed", 31, 40),
        ("open", 40, None),
    ]
    for at in range(5, 45):
        (stood,) = moment.moment(reading, world.name, to_datetime(START_US + at * SECOND_US)).doors
        (expected,) = [(s, a) for s, a, b in truth if a <= at and (b is None or at < b)] or [
            ("unknown", None)
        ]
        since = None if stood.since is None else (to_us(stood.since) - START_US) // SECOND_US
        assert (stood.state, since) == expected
    for start, end in [(0, 50), (20, 30), (22, 26), (31, 31), (0, 5)]:
        found = moment.door_states(
            reading, world.name, *(to_datetime(START_US + s * SECOND_US) for s in (start, end)), 100
        )
        got = [
            (
                f.state,
                *(None if s is None else (to_us(s) - START_US) // SECOND_US for s in (f.since, f.until)),
            )
            for f in found
        ]
        assert got == [(s, a, b) for s, a, b in truth if a <= end and (b is None or b > start)]
