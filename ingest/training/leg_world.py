"""Made-up places with people who stand and walk: what a leg classifier learns from besides real scans.

A place is a room full of furniture, an open hall, or the outdoors, from one seed: walls and flat sides as
segments, posts, table legs and trees as circles. People stand about alone and in groups, shift their weight
now and then, and walk from one spot to another with the simulator's gait. Their legs are ellipses of cloth;
at the height of knees they come closer together, and a coat or a skirt makes one of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from semap_ingest.simulation.gait import gait
from semap_ingest.simulation.motion import STEP_S, Motion, stand, walk
from semap_ingest.simulation.way import evenly_spaced

Floats = NDArray[np.float64]
Kind = Literal["hall", "furnished", "outdoors"]
KINDS: tuple[Kind, ...] = ("hall", "furnished", "outdoors")
CLEAR_M = (0.15, 0.4)
SHIFT_EVERY_S = 12.0
SHIFT_M = 0.03
TRIES = 40
NEXT_SPOT_M = 3.0


@dataclass(frozen=True, eq=False)
class World:
    """What never moves.

    segments_m  (s, 2, 2) walls, boxes, cupboards
    circles_m   (c, 3) x, y, radius: posts, legs of tables and chairs, bins, trees
    size_m      of the place, whose middle is the origin
    clear_m     so far from things people keep
    """

    segments_m: Floats
    circles_m: Floats
    size_m: tuple[float, float]
    clear_m: float

    def is_clear(self, place_m: Floats, margin_m: float) -> bool:
        """Whether nothing stands within a margin of a place (2,)."""
        if (np.abs(place_m) > np.asarray(self.size_m) / 2 - margin_m).any():
            return False
        near_m = np.hypot(*(self.circles_m[:, :2] - place_m).T) - self.circles_m[:, 2]
        return bool((near_m > margin_m).all() and (_to_segments(place_m, self.segments_m) > margin_m).all())

    def is_free_way(self, from_m: Floats, to_m: Floats) -> bool:
        steps = max(2, int(np.hypot(*(to_m - from_m)) / 0.2))
        return all(
            self.is_clear(from_m + k / steps * (to_m - from_m), self.clear_m) for k in range(steps + 1)
        )


@dataclass(frozen=True, eq=False)
class Person:
    """One body over time, a row each STEP_S.

    middle_m   (n, 2) between the legs
    legs_m     (n, k, 2) middles of the ellipses: two legs, or one coat
    facing_rad (n,)
    axes_m     (k, 2) half axes along and across the way it faces
    cloth_m    how far cloth is from an ellipse
    """

    middle_m: Floats
    legs_m: Floats
    facing_rad: Floats
    axes_m: Floats
    cloth_m: float


@dataclass(frozen=True, eq=False)
class Scene:
    world: World
    persons: tuple[Person, ...]
    length_s: float

    @property
    def rows(self) -> int:
        return round(self.length_s / STEP_S)


def scene(
    random: np.random.Generator,
    people: int,
    length_s: float,
    kind: Kind | None = None,
    standing: float = 0.5,
) -> Scene:
    """standing: share of the time that people stand"""
    chosen: Kind = kind or KINDS[int(random.integers(len(KINDS)))]
    place = world(chosen, random)
    height_m = any_height_m(random)
    middles = _spots(place, people, random)
    persons = tuple(_person(place, middle, length_s, height_m, standing, random) for middle in middles)
    return Scene(place, persons, length_s)


def world(kind: Kind, random: np.random.Generator) -> World:
    """A place without people."""
    if kind == "outdoors":
        size = tuple(random.uniform(15, 40, 2).tolist())
    elif kind == "hall":
        size = tuple(random.uniform(7, 16, 2).tolist())
    else:
        size = tuple(random.uniform(3, 9, 2).tolist())
    width, depth = size[0] / 2, size[1] / 2
    segments: list[Floats] = []
    circles: list[Floats] = []
    if kind != "outdoors" or random.random() < 0.5:
        corners = np.array([[-width, -depth], [width, -depth], [width, depth], [-width, depth]])
        for k in range(4):
            segments += _wall(corners[k], corners[(k + 1) % 4], random)
    area_m2 = size[0] * size[1]
    for make, per_m2 in _FURNITURE[kind]:
        for _ in range(random.poisson(min(per_m2 * area_m2, 25))):
            at = random.uniform(-1, 1, 2) * (width - 0.2, depth - 0.2)
            more_segments, more_circles = make(at, random)
            segments += more_segments
            circles += more_circles
    return World(
        np.array(segments).reshape(-1, 2, 2),
        np.array(circles).reshape(-1, 3),
        (size[0], size[1]),
        random.uniform(*CLEAR_M),
    )


def _wall(begin: Floats, end: Floats, random: np.random.Generator) -> list[Floats]:
    """A wall with doorways, set back here and there, as door frames and pillars are."""
    length = float(np.hypot(*(end - begin)))
    along = (end - begin) / length
    inward = np.array([-along[1], along[0]])
    cuts = np.sort(random.uniform(0, length, random.poisson(length / 2.5)))
    segments, at, back = [], 0.0, 0.0
    for cut in [*cuts.tolist(), length]:
        points = [begin + at * along + back * inward, begin + cut * along + back * inward]
        if random.random() < 0.85:
            segments.append(np.array(points))
        fresh = float(random.choice([0.0, 0.0, 0.05, 0.1, 0.2, 0.4]) * random.uniform(0.5, 1.5))
        corner = begin + cut * along
        segments.append(np.array([corner + back * inward, corner + fresh * inward]))
        at, back = cut, fresh
    return segments


Made = tuple[list[Floats], list[Floats]]


def _rectangle(at: Floats, size: Floats, turn_rad: float) -> Floats:
    """(4, 2) corners"""
    turn = np.array([[math.cos(turn_rad), -math.sin(turn_rad)], [math.sin(turn_rad), math.cos(turn_rad)]])
    offsets: Floats = at + (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size / 2) @ turn.T
    return offsets


def _box(at: Floats, random: np.random.Generator) -> Made:
    """A cupboard, a case, a bag: sizes from that of a leg on."""
    size = np.exp(random.uniform(np.log(0.08), np.log(1.6), 2))
    corners = _rectangle(at, size, random.uniform(0, math.pi))
    return [np.array([corners[k], corners[(k + 1) % 4]]) for k in range(4)], []


def _table(at: Floats, random: np.random.Generator) -> Made:
    corners = _rectangle(at, random.uniform(0.5, 2.0, 2), random.uniform(0, math.pi))
    return _legs_of(corners, random)


def _chair(at: Floats, random: np.random.Generator) -> Made:
    corners = _rectangle(at, random.uniform(0.35, 0.5, 2), random.uniform(0, math.pi))
    if random.random() < 0.3:
        middle = np.array([*corners.mean(axis=0), random.uniform(0.02, 0.04)])
        return [], [middle, *(np.array([*each, random.uniform(0.02, 0.035)]) for each in corners)]
    return _legs_of(corners, random)


def _legs_of(corners: Floats, random: np.random.Generator) -> Made:
    radius = random.uniform(0.008, 0.04)
    if random.random() < 0.4:
        sides = [_rectangle(each, np.full(2, 2 * radius), random.uniform(0, math.pi)) for each in corners]
        return [np.array([side[k], side[(k + 1) % 4]]) for side in sides for k in range(4)], []
    return [], [np.array([*each, radius]) for each in corners]


def _post(at: Floats, random: np.random.Generator) -> Made:
    return [], [np.array([*at, np.exp(random.uniform(np.log(0.02), np.log(0.35)))])]


def _bush(at: Floats, random: np.random.Generator) -> Made:
    """Many thin stems: outdoors, and whatever is a tangle indoors."""
    count, spread = random.integers(4, 30), random.uniform(0.1, 0.8)
    stems = at + spread * random.normal(0, 1, (count, 2))
    return [], [np.array([*each, random.uniform(0.005, 0.05)]) for each in stems]


_FURNITURE = {
    "hall": ((_box, 0.03), (_post, 0.02), (_table, 0.01), (_chair, 0.02), (_bush, 0.002)),
    "furnished": ((_box, 0.12), (_post, 0.06), (_table, 0.05), (_chair, 0.15), (_bush, 0.02)),
    "outdoors": ((_box, 0.01), (_post, 0.02), (_bush, 0.02)),
}


def _to_segments(place_m: Floats, segments_m: Floats) -> Floats:
    """(s,) distance of a place from each segment"""
    way = segments_m[:, 1] - segments_m[:, 0]
    share = ((place_m - segments_m[:, 0]) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12)
    nearest = segments_m[:, 0] + np.clip(share, 0, 1)[:, None] * way
    distance: Floats = np.hypot(*(nearest - place_m).T)
    return distance


def spot(place: World, random: np.random.Generator, around_m: Floats | None = None) -> Floats:
    """A clear place (2,), near another one if asked."""
    found = np.zeros(2)
    for _ in range(TRIES):
        if around_m is None:
            found = random.uniform(-0.5, 0.5, 2) * place.size_m
        else:
            found = around_m + random.normal(0, NEXT_SPOT_M, 2)
        if place.is_clear(found, place.clear_m):
            break
    return found


def _spots(place: World, people: int, random: np.random.Generator) -> list[Floats]:
    """Some stand in groups, some alone."""
    spots: list[Floats] = []
    while len(spots) < people:
        middle = spot(place, random)
        size = int(min(random.choice([1, 1, 1, 2, 3, 4]), people - len(spots)))
        turn, radius = random.uniform(0, math.tau), random.uniform(0.35, 0.8)
        for k in range(size):
            angle = turn + math.tau * k / size
            offset = (radius if size > 1 else 0.0) * np.array([math.cos(angle), math.sin(angle)])
            spots.append(middle + offset)
    return spots


def _person(
    place: World,
    start_m: Floats,
    length_s: float,
    height_m: float,
    standing: float,
    random: np.random.Generator,
) -> Person:
    heading = random.uniform(-math.pi, math.pi)
    motion = stand(start_m, heading, random.exponential(20.0) * standing / (1.01 - standing))
    while motion.length_s < length_s:
        here, heading = (motion.position_m[-1], motion.heading_rad[-1]) if len(motion) else (start_m, heading)
        there = spot(place, random, here)
        if place.is_free_way(here, there):
            motion = motion.then(
                walk(evenly_spaced(np.array([here, there])), heading, random.uniform(0.5, 1.6))
            )
            here, heading = motion.position_m[-1], motion.heading_rad[-1]
        pause_s = random.exponential(5.0) * standing / (1.01 - standing)
        motion = motion.then(stand(here, heading + random.normal(0, 0.3), min(pause_s + 0.2, 120.0)))
    count = round(length_s / STEP_S)
    return dressed(Motion(motion.position_m[:count], motion.heading_rad[:count]), height_m, random)


def any_height_m(random: np.random.Generator) -> float:
    """Of a laser over the floor."""
    return float(random.uniform(0.18, 0.52))


def passer_by(at_m: Floats, height_m: float, random: np.random.Generator) -> tuple[Person, int]:
    """Somebody who stands at a place, or walks through it, and the row at which it is there."""
    heading = random.uniform(-math.pi, math.pi)
    if random.random() < 0.5:
        motion = stand(at_m, heading, 3.0)
    else:
        half = np.array([math.cos(heading), math.sin(heading)])
        way = evenly_spaced(np.array([at_m - half, at_m + half]))
        motion = walk(way, heading, random.uniform(0.5, 1.5))
    return dressed(motion, height_m, random), len(motion) // 2


def dressed(motion: Motion, height_m: float, random: np.random.Generator) -> Person:
    """The legs of somebody who moves so, cut at that height over the floor."""
    walked = gait(motion)
    middle = walked.shins_m.mean(axis=1)
    if random.random() < 0.07:
        axes = random.uniform((0.10, 0.15), (0.18, 0.26))[None]
        return Person(middle, motion.position_m[:, None], motion.heading_rad, axes, 0.02)
    # legs stand apart at the ankles as they please, and are one body higher up
    apart = random.uniform(0.4, 1.9) * (1 - 0.5 * max(height_m - 0.2, 0.0))
    ahead = np.column_stack([np.cos(motion.heading_rad), np.sin(motion.heading_rad)])
    beside = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    offsets = walked.shins_m - middle[:, None]
    aside = np.einsum("nki,ni->nk", offsets, beside)
    offsets = offsets + ((apart - 1) * aside)[..., None] * beside[:, None, :]
    # who stands puts one foot before the other, and shifts
    stagger = random.normal(0, 0.06)
    offsets = offsets + np.array([0.5, -0.5])[:, None] * stagger * ahead[:, None, :]
    legs = middle[:, None] + offsets + _shifts(len(motion), random)
    girth = random.uniform(0.03, 0.085) * (1 + 0.9 * max(height_m - 0.25, 0.0))
    axes = girth * random.uniform(0.85, 1.3, 2)[None] * random.uniform(0.95, 1.05, (2, 1))
    return Person(middle, legs, motion.heading_rad, axes, float(random.uniform(0, 0.012)))


def _shifts(count: int, random: np.random.Generator) -> Floats:
    """(count, 2, 2): each leg stays where it is but for a shift now and then, and sways by millimetres."""
    times = np.arange(count) * STEP_S
    moved = np.zeros((count, 2, 2))
    for leg in range(2):
        at = np.cumsum(random.exponential(SHIFT_EVERY_S, 1 + int(2 * times[-1] / SHIFT_EVERY_S) + 1))
        for each in at[at < times[-1]]:
            eased = np.clip((times - each) / 0.4, 0, 1)
            moved[:, leg] += eased[:, None] * random.normal(0, SHIFT_M, 2)
            moved[:, leg] *= 0.9
    slow = np.sin(math.tau * random.uniform(0.1, 0.4) * times + random.uniform(0, math.tau))
    moved += 0.006 * slow[:, None, None] * random.normal(0, 1, 2)
    return moved
