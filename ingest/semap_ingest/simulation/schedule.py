"""Who goes where and when: a schedule that follows from a seed, and the world at each moment of it.

Persons are planned one passage at a time: a person leaves where it stands, walks to a door, opens it if it is
closed, passes, closes it again, and walks to where it will stand next. A passage is kept if it comes near no
other person and can be seen by the robot; else it begins a little later, or someone else or another door is
tried (prioritised planning: Erdmann and Lozano-Perez 1987). What is planned never changes any more, so that
each person's way is one sequence without jumps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.simulation.crowd import Crowd, Passage
from semap_ingest.simulation.floor import HALLWAY, ROBOT, Door, Floor, office_floor
from semap_ingest.simulation.gait import Gait, gait
from semap_ingest.simulation.moment import Body, Moment
from semap_ingest.simulation.motion import STEP_S, minimum_jerk
from semap_ingest.simulation.noise import Stream, noise
from semap_ingest.simulation.passage import plan_passage, plan_stroll
from semap_ingest.simulation.person import Person
from semap_ingest.simulation.settings import OfficeSettings

TRANSITIONS = 16
OPENINGS = 6
FULL_S = 93.0
FULL_PEOPLE = 4
"""With fewer people and in less time there are fewer passages."""

MOST_ACTORS = 6
STANDING_OPEN = 2
STANDING_OPEN_RAD = (np.radians(90.0), np.radians(96.0))
SETTLED_S = 1.5
"""Before the first passage begins, and after the last one."""

ROOM_FOR_LAST_S = 17.0
DELAYS_S = (0.0, 1.0, 2.5)
ATTEMPTS = 300


@dataclass(frozen=True)
class DoorMove:
    """A leaf that turns from one angle to another, with the speed of a hand (minimum jerk)."""

    door: str
    person: str
    start_s: float
    end_s: float
    from_rad: float
    to_rad: float

    def angle_rad(self, time_s: float) -> float:
        share = min(1.0, max(0.0, (time_s - self.start_s) / (self.end_s - self.start_s)))
        return float(self.from_rad + (self.to_rad - self.from_rad) * minimum_jerk(np.array(share)))


@dataclass(frozen=True, eq=False)
class Moments:
    """The whole course of a recording, in samples every hundredth of a second.

    passages  in the order of their times
    moves     of the doors, likewise
    """

    floor: Floor
    people: tuple[Person, ...]
    standing_rad: Mapping[str, float]
    passages: tuple[Passage, ...]
    moves: tuple[DoorMove, ...]
    duration_s: float

    def at(self, time_s: float) -> Moment:
        """The world at a time; before the beginning and after the end as it is there."""
        index = min(max(time_s / STEP_S, 0.0), len(self.people[0].motion) - 1.0)
        bodies = tuple(
            _body(person, walked, index) for person, walked in zip(self.people, self.gaits, strict=True)
        )
        return Moment(time_s, ROBOT, self.door_rad(time_s), bodies)

    def door_rad(self, time_s: float) -> dict[str, float]:
        """How far each leaf is open."""
        angles = {door.name: self.standing_rad.get(door.name, 0.0) for door in self.floor.leaf_doors}
        for move in self.moves:
            if move.start_s <= time_s:
                angles[move.door] = move.angle_rad(time_s)
        return angles

    @cached_property
    def gaits(self) -> tuple[Gait, ...]:
        return tuple(gait(person.motion) for person in self.people)


def moments(settings: OfficeSettings) -> Moments:
    """What happens in the office of these settings; the same for the same seed, people and duration.

    raises InvalidInput where no schedule was found, which takes many people in little time
    """
    wanted = wanted_passages(settings)
    for attempt in range(ATTEMPTS):
        random = noise(settings, Stream.SCHEDULE, attempt)
        found = _attempt(settings, random, *wanted)
        if found is not None:
            return found
    raise InvalidInput(
        f"no schedule was found for seed {settings.seed} with {settings.people} people",
        "Take another seed, fewer people or more time.",
    )


def wanted_passages(settings: OfficeSettings) -> tuple[int, int]:
    """How many changes of rooms there are, and how many of them through a door closed before and after."""
    share = min(1.0, settings.people / FULL_PEOPLE) * min(1.0, settings.duration_s / FULL_S)
    return floor(TRANSITIONS * share), floor(OPENINGS * share)


def _attempt(
    settings: OfficeSettings, random: np.random.Generator, transitions: int, openings: int
) -> Moments | None:
    the_floor = office_floor()
    standing_rad = _standing_open(the_floor, random)
    crowd = Crowd(the_floor, standing_rad, settings.duration_s)
    entered = [door.room for door in the_floor.doors.values() if door.is_watched]
    if not all(crowd.join(entered, random) for _ in range(min(settings.people, MOST_ACTORS))):
        return None
    by_hand = np.zeros(transitions, dtype=bool)
    by_hand[random.permutation(transitions)[:openings]] = True
    left = {True: openings, False: transitions - openings}
    for number, first_choice in enumerate(by_hand):
        earliest_s = SETTLED_S + number * max(0.0, settings.duration_s - ROOM_FOR_LAST_S) / transitions
        for is_closed in (bool(first_choice), not first_choice):
            if left[is_closed] and _add_passage(crowd, random, earliest_s, is_closed):
                left[is_closed] -= 1
                break
        else:
            return None
    rooms = [room for room in the_floor.rooms if room != HALLWAY]
    if not all(crowd.join(rooms, random) for _ in range(settings.people - len(crowd.people))):
        return None
    for person in range(settings.people):
        plan_stroll(crowd, person, random)
    passages = tuple(sorted(crowd.passages, key=lambda passage: passage.start_s))
    moves = sorted((move for passage in passages for move in _moves(passage)), key=lambda move: move.start_s)
    return Moments(the_floor, tuple(crowd.people), standing_rad, passages, tuple(moves), settings.duration_s)


def _standing_open(the_floor: Floor, random: np.random.Generator) -> dict[str, float]:
    watched = [door.name for door in the_floor.leaf_doors if door.is_watched]
    chosen = random.choice(len(watched), STANDING_OPEN, replace=False)
    return {watched[index]: float(random.uniform(*STANDING_OPEN_RAD)) for index in chosen}


def _add_passage(crowd: Crowd, random: np.random.Generator, earliest_s: float, is_closed: bool) -> bool:
    """Plan one more passage through a door that is closed (or through one that is not), whoever can first."""
    order = sorted(
        range(len(crowd.people)), key=lambda person: (max(crowd.free_s(person), earliest_s), random.random())
    )
    for person in order:
        start_s = max(crowd.free_s(person), earliest_s)
        doors = [door for door in _ways_out(crowd, person) if crowd.is_closed(door) == is_closed]
        for index in random.permutation(len(doors)):
            for delay_s in DELAYS_S:
                plan = plan_passage(crowd, person, doors[index], round(start_s + delay_s, 2), random)
                if plan is not None:
                    crowd.add(plan.passage, plan.motion, plan.person, plan.sight)
                    return True
    return False


def _ways_out(crowd: Crowd, person: int) -> list[Door]:
    room = crowd.room_of(person)
    return [door for door in crowd.floor.doors.values() if door.is_watched and (room in (HALLWAY, door.room))]


def _moves(passage: Passage) -> list[DoorMove]:
    """The leaf as a person moves it who passes a closed door."""
    if passage.opening_s is None or passage.closing_s is None:
        return []
    door, person, open_rad = passage.door.name, passage.person, passage.open_rad
    return [
        DoorMove(door, person, *passage.opening_s, 0.0, open_rad),
        DoorMove(door, person, *passage.closing_s, open_rad, 0.0),
    ]


def _body(person: Person, walked: Gait, index: float) -> Body:
    low, high = floor(index), ceil(index)
    share = index - low

    def between(samples: NDArray[np.float64]) -> NDArray[np.float64]:
        mixed: NDArray[np.float64] = samples[low] + share * (samples[high] - samples[low])
        return mixed

    return Body(
        name=person.name,
        position_m=between(person.motion.position_m),
        heading_rad=float(between(person.motion.heading_rad)),
        shins_m=between(walked.shins_m),
        shin_radius_m=person.shin_radius_m,
        phase_rad=float(between(walked.phase_rad)),
        swing=float(between(walked.swing)),
        height_m=person.height_m,
        width_m=person.width_m,
        depth_m=person.depth_m,
        clothes=person.clothes,
    )
