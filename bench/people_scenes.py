"""Where people stand and walk before a laser alone, and where they truly are: real bags, made-up places.

In a bag laser and room stand still, so that what moves is a person (`leg_samples.still_share`). What is in
its place for a part of the time may be a person who stands: a track there is neither right nor wrong.
Identities are linked from scan to scan; a bag has so many persons, and who comes back is one of them.

Made-up places (`leg_world`) are of seeds that no classifier has learnt from. Whom three beams meet is in
sight. The robot's pose is exact.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist
from semap_ingest.laser.detector import LegDetector
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.sensor import Sensor
from semap_ingest.recording.reading import Received, Recording
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.transform import Transform
from semap_ingest.simulation.motion import STEP_S
from semap_ingest.tracking.map_tracker import MapTrackerSettings
from semap_service.evaluation.mot_scores import Places, places_of

from ingest.training.leg_laser import Laser, row_at, seen
from ingest.training.leg_samples import BAGS, MOVING_SHARE, STILL_SHARE, Bag, still_share
from ingest.training.leg_world import Kind, Scene, World, scene, spot

Floats = NDArray[np.float64]
Drive = Literal["stands", "drives", "follows"]

START_US = 1_767_604_500_000_000
PERSONS_IN: Mapping[str, int] = {"positive_3": 2, "demo_stationary_simple_environment": 3}
BODY_M, BODY_POINTS, ASKED_TO_M = 0.4, 4, 8.0
BESIDE_M = 0.5
LEAST_BEAMS = 3
DRIVES_MPS, FOLLOWS_AT_M = 0.6, 1.3


@dataclass(frozen=True)
class Made:
    """A made-up scene: who is there, and the laser that looks.

    standing   share of the time that people stand
    step_deg, rate_hz, turned_deg, range_max_m  of the laser
    """

    name: str
    kind: Kind
    people: int
    standing: float
    drive: Drive
    step_deg: float
    rate_hz: float
    seed: int
    turned_deg: float = 270.0
    range_max_m: float = 20.0
    length_s: float = 60.0


HALL, FOLLOWED = ("hall", 12, 0.85), ("outdoors", 1, 0.1)
SCENES = (
    *(Made(f"hall of 12, seed {n}", *HALL, "stands", 0.35, 7.5, n) for n in (10_001, 10_002, 10_003)),
    *(Made(f"hall of 12, driving, seed {n}", *HALL, "drives", 0.35, 7.5, n) for n in range(10_001, 10_004)),
    Made("hall of 12, every second beam", *HALL, "stands", 0.7, 7.5, 10_001),
    Made("hall of 6", "hall", 6, 0.85, "stands", 1.0, 5.0, 10_004),
    Made("furnished, 3 people", "furnished", 3, 0.5, "stands", 0.25, 40.0, 10_005, length_s=30.0),
    Made("furnished, 4 people", "furnished", 4, 0.5, "stands", 0.5, 10.0, 10_006),
    *(Made(f"one followed outdoors, seed {n}", *FOLLOWED, "follows", 0.35, 7.5, n) for n in (10_007, 10_008)),
    Made("one followed outdoors, every second beam", *FOLLOWED, "follows", 0.7, 7.5, 10_007),
    Made("one followed indoors, another about", "furnished", 2, 0.3, "follows", 0.5, 10.0, 10_009),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Watched:
    """What a laser measured, and whom of.

    place    of a bag; a classifier that has learnt from it has seen the room
    truth    persons in sight, at the stamps of the scans
    unasked  (n, 3) stamp [us], x, y [m]: a track there that is nearer to none in sight does not count
    """

    name: str
    place: str | None
    records: Sequence[Received]
    truth: Places
    unasked: Floats


def of_bags(folder: Path) -> Iterator[Watched]:
    """The bags with people in them, each on a map that is its laser's frame."""
    for bag in BAGS:
        if bag.how != "empty":
            yield of_bag(folder, bag)


def of_scenes(scenes: Sequence[Made] = SCENES) -> Iterator[Watched]:
    for made in scenes:
        yield _of_scene(made)


def tracks_of(watched: Watched, legs: LegDetector, settings: MapTrackerSettings | None = None) -> Places:
    """The tracks of a laser alone, without those that are not asked about."""
    stamps_us = [each.value.stamp_us for each in watched.records if isinstance(each.value, Scan)]
    period_us = round(0.9 * float(np.diff(stamps_us).min()))
    perception = Perception([Sensor("laser", "laser", "/scan", legs, period_us=period_us)], tracking=settings)
    found = [each for record in watched.records for each in perception.take(record).persons]
    told = places_of(each.states for each in (*found, *perception.flush().persons))
    kept = np.ones(len(told), np.bool_)
    for row, (stamp_us, position_m) in enumerate(zip(told.stamp_us, told.position_m, strict=True)):
        unasked_m = watched.unasked[watched.unasked[:, 0] == stamp_us, 1:]
        asked_m = watched.truth.position_m[watched.truth.stamp_us == stamp_us]
        from_unasked_m = cdist(position_m[None], unasked_m).min(initial=np.inf)
        kept[row] = from_unasked_m > min(BESIDE_M, cdist(position_m[None], asked_m).min(initial=np.inf))
    return Places(told.stamp_us[kept], told.identity[kept], told.position_m[kept])


def of_bag(folder: Path, bag: Bag) -> Watched:
    with Recording(folder / bag.path) as recording:
        scans = [each.value for each in recording.records() if isinstance(each.value, Scan)]
    share = still_share(scans)
    last_m = np.full((PERSONS_IN.get(bag.name, 1), 2), np.inf)
    stamps: list[int] = []
    who: list[int] = []
    places: list[Floats] = []
    unasked = []
    for scan, still in zip(scans, share, strict=True):
        bodies_m = _bodies(scan.points_m[scan.is_return & (still < MOVING_SHARE)])
        linked = _linked(last_m, bodies_m)
        for person, body in linked:
            last_m[person] = bodies_m[body]
            stamps.append(scan.stamp_us)
            who.append(person)
            places.append(bodies_m[body])
        asked_m = bodies_m[[body for _, body in linked]]
        points_m = scan.points_m[scan.is_return & (still < STILL_SHARE)]
        of_nobody = points_m[(cdist(points_m, asked_m) > BODY_M).all(axis=1)]
        unasked.append(np.column_stack([np.full(len(of_nobody), scan.stamp_us, np.float64), of_nobody]))
    stands = _at(scans[0].stamp_us, scans[0].frame, (0.0, 0.0, 0.0), is_static=True)
    records = [stands, *(Received(scan.stamp_us, "/scan", scan) for scan in scans)]
    truth = Places(np.array(stamps, np.int64), np.array(who, np.int64), np.array(places).reshape(-1, 2))
    return Watched(bag.name, bag.place, records, truth, np.concatenate(unasked))


def _bodies(points_m: Floats) -> Floats:
    """(n, 2) middles of what moves together."""
    points_m = points_m[np.hypot(*points_m.T) < ASKED_TO_M]
    if len(points_m) < BODY_POINTS:
        return np.zeros((0, 2))
    links = cKDTree(points_m).query_pairs(BODY_M, output_type="ndarray")
    graph = coo_array((np.ones(len(links)), links.T), shape=(len(points_m), len(points_m)))
    count, body = connected_components(graph, directed=False)
    size = np.bincount(body, minlength=count)
    middle = np.column_stack([np.bincount(body, axis, count) for axis in points_m.T]) / size[:, None]
    return np.asarray(middle[size >= BODY_POINTS])


def _linked(last_m: Floats, bodies_m: Floats) -> list[tuple[int, int]]:
    """Persons and their bodies, who are nearest to where they were last; who was never seen is anywhere."""
    away_m = np.minimum(cdist(np.nan_to_num(last_m, posinf=1e6), bodies_m), 1e3)
    return list(zip(*(each.tolist() for each in linear_sum_assignment(away_m)), strict=True))


def _of_scene(made: Made) -> Watched:
    random = np.random.default_rng([3, made.seed])
    place = scene(random, made.people, made.length_s, made.kind, made.standing)
    step_rad, turned_rad = math.radians(made.step_deg), math.radians(made.turned_deg)
    laser = Laser(step_rad, turned_rad, made.range_max_m, made.rate_hz, 0.01, 0.0, 0.001, 0.2, 0.005)
    course = _course(place, made.drive, random)
    records = []
    stamps: list[int] = []
    who: list[int] = []
    places: list[Floats] = []
    unasked: list[Floats] = []
    for number in range(int(made.length_s * made.rate_hz)):
        row, stamp_us = row_at(number / made.rate_hz), START_US + round(1e6 * number / made.rate_hz)
        scan, whom = seen(place, laser, tuple(course[row].tolist()), row, random, stamp_us)
        records += [_at(stamp_us, scan.frame, tuple(course[row].tolist())), Received(stamp_us, "/scan", scan)]
        beams = np.bincount(whom[(whom >= 0) & scan.is_return], minlength=made.people)
        for person, middle_m in enumerate(body.middle_m[row] for body in place.persons):
            if beams[person] >= LEAST_BEAMS:
                stamps.append(stamp_us)
                who.append(person)
                places.append(middle_m)
            else:
                unasked.append(np.array([stamp_us, *middle_m]))
    truth = Places(np.array(stamps, np.int64), np.array(who, np.int64), np.array(places))
    return Watched(made.name, None, records, truth, np.array(unasked).reshape(-1, 3))


def _course(place: Scene, drive: Drive, random: np.random.Generator) -> Floats:
    """(rows, 3) x, y [m], yaw [rad] of the robot."""
    if drive == "follows":
        return _behind(place.persons[0].middle_m)
    start = spot(place.world, random)
    if drive == "stands":
        return np.tile([*start, random.uniform(-math.pi, math.pi)], (place.rows, 1))
    return _driven(place.world, start, place.rows, random)


def _driven(world: World, at_m: Floats, rows: int, random: np.random.Generator) -> Floats:
    """From clear spot to clear spot, turning at up to a radian a second."""
    yaw_rad, there_m, course = random.uniform(-math.pi, math.pi), at_m, []
    for _ in range(rows):
        if np.hypot(*(there_m - at_m)) < 0.1:
            wanted = spot(world, random)
            there_m = wanted if world.is_free_way(at_m, wanted) else there_m
        way_m = there_m - at_m
        aside_rad = math.remainder(math.atan2(way_m[1], way_m[0]) - yaw_rad, math.tau)
        if np.hypot(*way_m) >= 0.1:
            yaw_rad += float(np.clip(aside_rad, -STEP_S, STEP_S))
            if abs(aside_rad) < 0.3:
                at_m = at_m + DRIVES_MPS * STEP_S * way_m / np.hypot(*way_m)
        course.append([*at_m, yaw_rad])
    return np.array(course)


def _behind(person_m: Floats) -> Floats:
    """Towards a person, up to a distance, as fast as it is away from that."""
    at_m, course = person_m[0] - [FOLLOWS_AT_M, 0.0], []
    for middle_m in person_m:
        way_m = middle_m - at_m
        away_m = np.hypot(*way_m)
        at_m = at_m + np.clip(1.5 * (away_m - FOLLOWS_AT_M), 0.0, 1.8) * STEP_S * way_m / away_m
        course.append([*at_m, math.atan2(way_m[1], way_m[0])])
    return np.array(course)


def _at(stamp_us: int, frame: str, pose: tuple[float, ...], *, is_static: bool = False) -> Received:
    x_m, y_m, yaw_rad = pose
    turn = np.array([0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)])
    place = Transform(stamp_us, "map", frame, np.array([x_m, y_m, 0.3]), turn, is_static=is_static)
    return Received(stamp_us, "/tf", place)
