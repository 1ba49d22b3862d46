"""Everybody's way as far as it is planned, and where there is room for one more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point

from semap_ingest.simulation.floor import (
    HALLWAY,
    ROBOT,
    ROBOT_RADIUS_M,
    Door,
    Floor,
    laser_place_m,
    office_floor,
)
from semap_ingest.simulation.motion import STEP_S, Motion, stand
from semap_ingest.simulation.person import NAMES, Person, drawn_person
from semap_ingest.simulation.ray import is_near

CLEAR_OF_WALL_M = 0.36
CLEAR_OF_THING_M = 0.34
CLEAR_OF_LEAF_M = 0.32
APART_M = 0.66
"""Between the middles of two bodies."""

STANDING_APART_M = 0.95
CLEAR_OF_DOOR_M = 1.1
LOOK_EVERY = 10
"""Samples between two looks for others: a tenth of a second."""

VIEW_RAD = np.radians(47.0)
IN_VIEW_SHARE = 0.15
SPOTS_TRIED = 60
PLACES_TRIED = 40
BODY_RADIUS_M = 0.3
HIDDEN_SHARE = 0.15
FARTHEST_M = 5.5
"""From a door to where one goes after passing it."""

IN_HALLWAY_SHARE = 0.5


@dataclass(frozen=True)
class Passage:
    """A person changes between the hallway and a room.

    opening_s, closing_s  from when until when the person turns the leaf; None where nobody needs to
    """

    person: str
    door: Door
    kind: Literal["entered", "left"]
    start_s: float
    end_s: float
    complete_s: float
    opening_s: tuple[float, float] | None = None
    closing_s: tuple[float, float] | None = None
    open_rad: float = 0.0


@dataclass(frozen=True, eq=False)
class Sight:
    """What the robot sees of a passage.

    samples   (n,) of the recording, until shortly after the passage is complete
    body_m    (n, 2) where the body is then
    hidden    (n,), what cannot be seen even if nobody else is there
    """

    person: int
    samples: NDArray[np.int64]
    body_m: NDArray[np.float64]
    hidden: NDArray[np.bool_]

    def is_hidden_by(self, person: int, first: int, own_m: NDArray[np.float64]) -> bool:
        """Whether somebody at `own_m` from sample `first` on stands in the way for long, or at the end."""
        inside = self.samples >= first
        if person == self.person or not inside.any():
            return False
        middles_m = own_m[self.samples[inside] - first]
        near = is_near(laser_place_m(), self.body_m[inside], middles_m, BODY_RADIUS_M)
        return bool(near[-1]) or float(np.mean(near)) > HIDDEN_SHARE

    @property
    def is_seen(self) -> bool:
        return not self.hidden[-1] and float(np.mean(self.hidden)) <= HIDDEN_SHARE


class Crowd:
    """All persons, each with a motion for the whole recording; where no more is planned they stand."""

    def __init__(self, floor: Floor, standing_rad: Mapping[str, float], duration_s: float) -> None:
        self.floor = floor
        self.people: list[Person] = []
        self.passages: list[Passage] = []
        self._standing_rad = standing_rad
        self._count = round(duration_s / STEP_S) + 2
        self._rooms: list[str] = []
        self._free: list[int] = []
        self._sights: list[Sight] = []

    def join(self, rooms: Sequence[str], random: np.random.Generator) -> bool:
        """One more person, who stands in the hallway or in some room; False where no place was left."""
        for _ in range(PLACES_TRIED):
            room = HALLWAY if random.random() < IN_HALLWAY_SHARE else rooms[int(random.integers(len(rooms)))]
            place_m = self.spot(room, 0.0, random)
            if place_m is None:
                continue
            standing = stand(place_m, float(random.uniform(-np.pi, np.pi)), self._count * STEP_S)
            if self._is_clear(len(self.people), 0, standing.position_m):
                self.people.append(drawn_person(NAMES[len(self.people)], standing, random))
                self._rooms.append(room)
                self._free.append(0)
                return True
        return False

    @property
    def length_s(self) -> float:
        return (self._count - 2) * STEP_S

    def room_of(self, person: int) -> str:
        """Where somebody is when nothing more is planned."""
        return self._rooms[person]

    def free_s(self, person: int) -> float:
        return self._free[person] * STEP_S

    def is_closed(self, door: Door) -> bool:
        """Whether it is closed but for those who pass it."""
        return door.hinge is not None and door.name not in self._standing_rad

    def leaf_rad(self, door: Door) -> float:
        return self._standing_rad.get(door.name, 0.0)

    def add(self, passage: Passage, motion: Motion, person: int, sight: Sight) -> None:
        """Somebody makes a passage, which nobody may hide who is planned later."""
        self.passages.append(passage)
        self._sights.append(sight)
        self._rooms[person] = passage.door.room if passage.kind == "entered" else HALLWAY
        self.move(person, passage.start_s, motion)

    def move(self, person: int, start_s: float, motion: Motion) -> None:
        """Somebody moves from a time on, and then stands."""
        first = round(start_s / STEP_S) + 1
        position_m = self.people[person].motion.position_m.copy()
        heading_rad = self.people[person].motion.heading_rad.copy()
        last = first + len(motion)
        position_m[first:last], position_m[last:] = motion.position_m, motion.position_m[-1]
        heading_rad[first:last], heading_rad[last:] = motion.heading_rad, motion.heading_rad[-1]
        self.people[person] = replace(self.people[person], motion=Motion(position_m, heading_rad))
        self._free[person] = last - 1

    def is_clear(self, person: int, start_s: float, motion: Motion) -> bool:
        """Whether somebody who moves so, and then stands, comes near nobody and hides no passage."""
        first = round(start_s / STEP_S) + 1
        after = self._count - first - len(motion)
        if after < 0:
            return False
        own_m = np.concatenate([motion.position_m, np.tile(motion.position_m[-1], (after, 1))])
        return self._is_clear(person, first, own_m)

    def _is_clear(self, person: int, first: int, own_m: NDArray[np.float64]) -> bool:
        return all(
            (_distances(own_m[::LOOK_EVERY], other.motion.position_m[first::LOOK_EVERY]) >= APART_M).all()
            for number, other in enumerate(self.people)
            if number != person
        ) and not any(sight.is_hidden_by(person, first, own_m) for sight in self._sights)

    def walkable(self, room: str, person: int, start_s: float) -> shapely.Geometry:
        """Where the middle of a body can be in a room, around those who stand there [m, map]."""
        area = _walkable(room, tuple(sorted(self._standing_rad)))
        now = min(round(start_s / STEP_S), self._count - 1)
        later = min(now + 300, self._count - 1)
        standing = [
            other.motion.position_m[now]
            for number, other in enumerate(self.people)
            if number != person and (other.motion.position_m[now] == other.motion.position_m[later]).all()
        ]
        if not standing:
            return area
        circles = shapely.buffer(shapely.points(np.array(standing)), APART_M + 0.04, quad_segs=2)
        return shapely.difference(area, shapely.union_all(circles))

    def spot(
        self,
        room: str,
        time_s: float,
        random: np.random.Generator,
        person: int = -1,
        near: Door | None = None,
    ) -> NDArray[np.float64] | None:
        """(2,) somewhere in a room where one can stand for long; None if nothing was found."""
        area = _walkable(room, tuple(sorted(self._standing_rad)))
        low_x, low_y, high_x, high_y = area.bounds
        index = min(round(time_s / STEP_S), self._count - 1)
        others = [
            each.motion.position_m[index] for number, each in enumerate(self.people) if number != person
        ]
        fronts = _door_sides(room)
        for _ in range(SPOTS_TRIED):
            place_m = np.array([random.uniform(low_x, high_x), random.uniform(low_y, high_y)])
            may_hide = random.random() < IN_VIEW_SHARE
            if (
                area.contains(Point(place_m))
                and (_distances(place_m, fronts) >= CLEAR_OF_DOOR_M).all()
                and (not others or (_distances(place_m, np.array(others)) >= STANDING_APART_M).all())
                and (near is None or np.linalg.norm(place_m - near.position_m) <= FARTHEST_M)
                and (room != HALLWAY or may_hide or not _in_view(place_m))
            ):
                return place_m
        return None


def _distances(points_m: NDArray[np.float64], others_m: NDArray[np.float64]) -> NDArray[np.float64]:
    apart: NDArray[np.float64] = np.linalg.norm(points_m - others_m, axis=-1)
    return apart


def _in_view(place_m: NDArray[np.float64]) -> bool:
    """Whether somebody there could stand before a door, as the robot sees it."""
    ahead = place_m - np.array(ROBOT[:2])
    bearing_rad = np.arctan2(ahead[1], ahead[0]) - ROBOT[2]
    return bool(abs(np.arctan2(np.sin(bearing_rad), np.cos(bearing_rad))) < VIEW_RAD)


@cache
def _door_sides(room: str) -> NDArray[np.float64]:
    """(n, 2) before the doors of a room, where others pass [m, map]."""
    depth_m = -0.7 if room == HALLWAY else 0.8
    doors = [door for door in office_floor().doors.values() if room in (HALLWAY, door.room)]
    return np.array([door.to_map(np.array([[0.0, depth_m]]))[0] for door in doors])


@cache
def _walkable(room: str, standing_open: tuple[str, ...]) -> shapely.Geometry:
    the_floor = office_floor()
    area = the_floor.rooms[room].buffer(-CLEAR_OF_WALL_M, join_style="mitre")
    taken = [
        thing.footprint.buffer(CLEAR_OF_THING_M, quad_segs=2)
        for thing in the_floor.things
        if the_floor.rooms[room].intersects(thing.footprint)
    ]
    taken += [_swept(door) for door in the_floor.leaf_doors if door.room == room]
    if room == HALLWAY:
        taken.append(Point(ROBOT[:2]).buffer(ROBOT_RADIUS_M + CLEAR_OF_THING_M, quad_segs=2))
    return shapely.difference(area, shapely.union_all(taken))


def _swept(door: Door) -> shapely.Geometry:
    """Where a body would be hit by the leaf [m, map]."""
    reach = 1 + CLEAR_OF_LEAF_M / door.width_m
    angles = np.radians(np.arange(-10, 106, 5))
    hinge_m = door.leaf_m(0.0)[0]
    arc = [hinge_m + reach * (door.leaf_m(angle)[1] - hinge_m) for angle in angles]
    return shapely.Polygon([hinge_m, *arc])
