"""How somebody passes a door, or strolls about: planned against all that is planned already."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, remainder, sin, tau

import numpy as np
from numpy.typing import NDArray

from semap_ingest.simulation.crowd import Crowd, Passage, Sight
from semap_ingest.simulation.floor import HALLWAY, WALL_M, Door, laser_place_m
from semap_ingest.simulation.motion import STEP_S, Motion, stand, turn, walk
from semap_ingest.simulation.person import Person, is_all_inside
from semap_ingest.simulation.ray import is_crossed
from semap_ingest.simulation.way import Polyline, rounded, shortest_way

BEFORE_DOOR_M = 0.59
"""From the plane of the leaf to the middle of somebody who stands before it in the hallway."""

BESIDE_HANDLE_M = 0.1
BEHIND_LEAF_M = 0.35
BEHIND_LEAF_RAD = radians(72.0)
"""Inside, one stands beyond the reach of the leaf, so far round from where it closes."""

TURN_TO_CLOSE_RAD = radians(100.0)
OPENING_S = (1.0, 1.6)
OPEN_RAD = (radians(88.0), radians(96.0))
HAND_ON_HANDLE_S = (0.2, 0.5)
PAUSE_S = (0.2, 0.8)
SETTLED_S = 1.5
BY_HAND_S = 9.0
FREELY_S = 4.0
"""What a passage takes at least."""

SPOTS = 3
SEEN_S = 0.7
SEEN_AFTER_S = 0.1
LEG_ASIDE_M = 0.1
STROLL_PAUSE_S = (1.0, 7.0)
STROLLS = 30


@dataclass(frozen=True, eq=False)
class Plan:
    """A passage with all of its motion, and who moves so."""

    passage: Passage
    motion: Motion
    person: int
    sight: Sight


def plan_passage(
    crowd: Crowd, person: int, door: Door, start_s: float, random: np.random.Generator
) -> Plan | None:
    """Through a door into the room, or out of the room that one is in; None where that cannot be now."""
    shortest_s = BY_HAND_S if crowd.is_closed(door) else FREELY_S
    if start_s + shortest_s > crowd.length_s:
        return None
    enters = crowd.room_of(person) == HALLWAY
    goal = door.room if enters else HALLWAY
    crossing = _by_hand if crowd.is_closed(door) else _freely
    for _ in range(SPOTS):
        place_m = crowd.spot(goal, start_s, random, person, door)
        plan = None if place_m is None else crossing(crowd, person, door, start_s, place_m, random)
        if plan is not None and _is_possible(crowd, plan):
            return plan
    return None


def plan_stroll(crowd: Crowd, person: int, random: np.random.Generator) -> None:
    """Walk to and fro in the room that one is in, with pauses, until the end."""
    who = crowd.people[person]
    room = crowd.room_of(person)
    start_s = crowd.free_s(person)
    for _ in range(STROLLS):
        start_s = round(start_s + random.uniform(*STROLL_PAUSE_S), 2)
        if start_s > crowd.length_s:
            return
        place_m = crowd.spot(room, start_s, random, person)
        if place_m is None:
            continue
        here_m, heading_rad = _stands(who, start_s)
        way = shortest_way(crowd.walkable(room, person, start_s), here_m, place_m)
        if way is None:
            continue
        motion = walk(rounded(way), heading_rad, who.cruise_mps)
        if crowd.is_clear(person, start_s, motion):
            crowd.move(person, start_s, motion)
            who = crowd.people[person]
            start_s = crowd.free_s(person)


def _freely(
    crowd: Crowd, person: int, door: Door, start_s: float, place_m: Polyline, random: np.random.Generator
) -> Plan | None:
    """Through an opening or an open door in one go."""
    del random
    who = crowd.people[person]
    enters = crowd.room_of(person) == HALLWAY
    here_m, heading_rad = _stands(who, start_s)
    front, inner = door.to_map(np.array([[0.0, -0.75], _inside(door)]))
    first, last = (front, inner) if enters else (inner, front)
    rooms = (HALLWAY, door.room) if enters else (door.room, HALLWAY)
    gap = door.to_map(np.array([[0.0, -0.45], [0.0, 0.45]]))
    before = shortest_way(crowd.walkable(rooms[0], person, start_s), here_m, first)
    after = shortest_way(crowd.walkable(rooms[1], person, start_s), last, place_m)
    if before is None or after is None:
        return None
    way = rounded(np.concatenate([before, gap if enters else gap[::-1], after]))
    return _timed(crowd, person, door, start_s, walk(way, heading_rad, who.cruise_mps))


def _by_hand(
    crowd: Crowd, person: int, door: Door, start_s: float, place_m: Polyline, random: np.random.Generator
) -> Plan | None:
    """Walk to a closed door, open it, pass, close it, walk on."""
    who = crowd.people[person]
    enters = crowd.room_of(person) == HALLWAY
    rooms = (HALLWAY, door.room) if enters else (door.room, HALLWAY)
    here_m, heading_rad = _stands(who, start_s)
    handle_x_m = -door.hinge_sign * door.width_m / 2
    front = [handle_x_m - door.hinge_sign * BESIDE_HANDLE_M, -BEFORE_DOOR_M]
    points = door.to_map(
        np.array([front, [0.0, -0.45], [0.0, 0.35], _inside(door), [handle_x_m, 0.0], [0.0, 1.0]])
    )
    handle_m, through = points[4], points[:4] if enters else points[3::-1]
    before = shortest_way(crowd.walkable(rooms[0], person, start_s), here_m, through[0])
    after = shortest_way(crowd.walkable(rooms[1], person, start_s), through[-1], place_m)
    if before is None or after is None:
        return None
    to_handle = handle_m - through[0]
    arrival = walk(rounded(before), heading_rad, who.cruise_mps)
    arrival = arrival.then(turn(through[0], arrival.heading_rad[-1], np.arctan2(to_handle[1], to_handle[0])))
    reach_s, opening_s = random.uniform(*HAND_ON_HANDLE_S), random.uniform(*OPENING_S)
    opened = arrival.then(stand(through[0], arrival.heading_rad[-1], reach_s + opening_s))
    passed = opened.then(walk(rounded(through), opened.heading_rad[-1], min(who.cruise_mps, 1.1)))
    wait_s, closing_s = random.uniform(*HAND_ON_HANDLE_S), random.uniform(*OPENING_S)
    closed = passed.then(_turn_and_stand(passed, handle_m, wait_s + closing_s + random.uniform(*PAUSE_S)))
    motion = closed.then(walk(rounded(after), closed.heading_rad[-1], who.cruise_mps))
    opening_from_s = start_s + arrival.length_s + reach_s
    closing_from_s = start_s + passed.length_s + wait_s
    return _timed(
        crowd, person, door, start_s, motion,
        opening=(opening_from_s, opening_from_s + opening_s),
        closing=(closing_from_s, closing_from_s + closing_s),
        open_rad=float(random.uniform(*OPEN_RAD)),
    )  # fmt: skip


def _timed(
    crowd: Crowd,
    person: int,
    door: Door,
    start_s: float,
    motion: Motion,
    opening: tuple[float, float] | None = None,
    closing: tuple[float, float] | None = None,
    open_rad: float = 0.0,
) -> Plan | None:
    who = crowd.people[person]
    enters = crowd.room_of(person) == HALLWAY
    goal = crowd.floor.rooms[door.room if enters else HALLWAY]
    inside = is_all_inside(goal, motion.position_m, motion.heading_rad, who.width_m, who.depth_m)
    if not inside[-1]:
        return None
    begins = np.flatnonzero(inside & ~np.concatenate([[False], inside[:-1]]))
    passage = Passage(
        person=who.name,
        door=door,
        kind="entered" if enters else "left",
        start_s=start_s,
        end_s=start_s + motion.length_s,
        complete_s=start_s + (int(begins[0]) + 1) * STEP_S,
        opening_s=opening,
        closing_s=closing,
        open_rad=open_rad,
    )
    return Plan(passage, motion, person, _sight(crowd, person, passage, motion))


def _is_possible(crowd: Crowd, plan: Plan) -> bool:
    passage = plan.passage
    if passage.end_s > crowd.length_s - SETTLED_S / 2:
        return False
    for other in crowd.passages:
        is_apart = other.start_s > passage.end_s + SETTLED_S or other.end_s + SETTLED_S < passage.start_s
        if other.door.name == passage.door.name and passage.opening_s and not is_apart:
            return False
    if not plan.sight.is_seen or not crowd.is_clear(plan.person, passage.start_s, plan.motion):
        return False
    return not any(
        plan.sight.is_hidden_by(number, 0, other.motion.position_m)
        for number, other in enumerate(crowd.people)
    )


def _sight(crowd: Crowd, person: int, passage: Passage, motion: Motion) -> Sight:
    """What walls, furniture and the leaf leave to see of it, until shortly after it is complete."""
    first = round(passage.start_s / STEP_S) + 1
    last = round((passage.complete_s + SEEN_AFTER_S) / STEP_S)
    samples = np.arange(last, max(first, last - round(SEEN_S / STEP_S)) - 1, -5)[::-1]
    body_m = motion.position_m[samples - first]
    door = passage.door
    segments_m = crowd.floor.laser_segments
    if door.hinge:
        angle_rad = passage.open_rad if crowd.is_closed(door) else crowd.leaf_rad(door)
        segments_m = np.concatenate([segments_m, door.leaf_m(angle_rad)[None]])
    laser_m = laser_place_m()
    ray = body_m - laser_m
    aside = LEG_ASIDE_M * np.column_stack([-ray[:, 1], ray[:, 0]]) / np.linalg.norm(ray, axis=1)[:, None]
    hidden = np.logical_or(*(is_crossed(laser_m, body_m + side * aside, segments_m) for side in (-1, 1)))
    return Sight(person, samples, body_m, hidden)


def _inside(door: Door) -> list[float]:
    """Where one stands in the room to open or close [m, door's frame]; behind an opening, straight on."""
    if door.hinge is None:
        return [0.0, 0.9 + WALL_M / 2]
    radius_m = door.width_m + BEHIND_LEAF_M
    along_m = door.width_m / 2 - radius_m * cos(BEHIND_LEAF_RAD)
    return [door.hinge_sign * along_m, radius_m * sin(BEHIND_LEAF_RAD)]


def _stands(who: Person, start_s: float) -> tuple[NDArray[np.float64], float]:
    index = round(start_s / STEP_S)
    return who.motion.position_m[index], float(who.motion.heading_rad[index])


def _turn_and_stand(passed: Motion, handle_m: NDArray[np.float64], length_s: float) -> Motion:
    """Half turned to the leaf that one closes; the turn is part of the time."""
    here_m, heading_rad = passed.position_m[-1], float(passed.heading_rad[-1])
    to_handle = handle_m - here_m
    change_rad = remainder(float(np.arctan2(to_handle[1], to_handle[0])) - heading_rad, tau)
    change_rad = float(np.clip(change_rad, -TURN_TO_CLOSE_RAD, TURN_TO_CLOSE_RAD))
    turned = turn(here_m, heading_rad, heading_rad + change_rad)
    last_rad = float(turned.heading_rad[-1]) if len(turned) else heading_rad
    return turned.then(stand(here_m, last_rad, max(0.0, length_s - turned.length_s)))
