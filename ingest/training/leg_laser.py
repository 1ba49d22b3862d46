"""What a laser measures in a made-up place: any resolution, rate, noise and mount."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from semap_ingest.sensing.scan import Scan
from semap_ingest.simulation.motion import STEP_S
from semap_ingest.simulation.ray import to_segments

from ingest.training.leg_world import Person, Scene, World

Floats = NDArray[np.float64]
NOBODY = -1


@dataclass(frozen=True)
class Laser:
    """One sensor.

    step_rad, turned_rad  between two beams, and from the first to the last
    noise_m, noise_share  of a range: constant, and in proportion to it
    quantum_m             of its numbers
    mixed, lost           share of beams at an edge that return something in between, and of all that are lost
    """

    step_rad: float
    turned_rad: float
    range_max_m: float
    rate_hz: float
    noise_m: float
    noise_share: float
    quantum_m: float
    mixed: float
    lost: float


def any_laser(random: np.random.Generator) -> Laser:
    """One of those that robots have: 0.25 to 1 degree, 5 to 40 Hz."""
    return Laser(
        math.radians(float(random.choice([0.25, 0.33, 0.36, 0.5, 0.7, 1.0]) * random.uniform(0.95, 1.05))),
        math.radians(float(random.choice([180, 240, 270, 360]))),
        float(random.choice([5.6, 8, 11, 20, 30])),
        float(random.choice([5, 7.5, 10, 15, 20, 40])),
        float(random.uniform(0.003, 0.022)),
        float(random.choice([0.0, 0.0, 0.005, 0.01])),
        float(random.choice([0.001, 0.001, 0.01])),
        float(random.uniform(0.0, 0.4)),
        float(random.choice([0.0, 0.005, 0.02])),
    )


def seen(
    scene: Scene,
    laser: Laser,
    place: tuple[float, float, float],
    row: int,
    random: np.random.Generator,
    stamp_us: int = 0,
    frame: str = "laser",
) -> tuple[Scan, NDArray[np.int64]]:
    """A scan from x, y [m], yaw [rad] at a row of the persons' time; and whom each beam met, or NOBODY."""
    x_m, y_m, yaw_rad = place
    count = round(laser.turned_rad / laser.step_rad)
    angles = yaw_rad - laser.turned_rad / 2 + laser.step_rad * np.arange(count)
    beams = np.column_stack([np.cos(angles), np.sin(angles)])
    at = np.array([x_m, y_m])
    true_m, whom = with_persons(background(scene.world, at, beams), scene.persons, at, beams, row, random)
    ranges_m = measured(true_m, laser, random)
    first_rad = -laser.turned_rad / 2
    scan = Scan(stamp_us, frame, first_rad, laser.step_rad, 0.03, laser.range_max_m, ranges_m)
    return scan, whom


def background(world: World, at_m: Floats, beams: Floats) -> Floats:
    """(n,) ranges to what never moves."""
    ranges = to_segments(at_m, beams, world.segments_m)
    for x, y, radius in world.circles_m.tolist():
        met = _to_ellipse(at_m, beams, np.array([x, y]), 0.0, np.array([radius, radius]))
        ranges = np.minimum(ranges, met)
    return ranges


def with_persons(
    ranges_m: Floats,
    persons: tuple[Person, ...],
    at_m: Floats,
    beams: Floats,
    row: int,
    random: np.random.Generator,
) -> tuple[Floats, NDArray[np.int64]]:
    """Ranges (n,) with persons before them, and whom each beam met."""
    whom = np.full(len(beams), NOBODY)
    for number, person in enumerate(persons):
        for leg_m, axes_m in zip(person.legs_m[row], person.axes_m, strict=True):
            met = _to_ellipse(at_m, beams, leg_m, float(person.facing_rad[row]), axes_m)
            is_met = np.isfinite(met)
            if not is_met.any():
                continue
            beam = np.flatnonzero(is_met)
            folds = np.interp(np.linspace(0, 1, len(beam)), np.linspace(0, 1, 6), random.normal(0, 1, 6))
            met[beam] += person.cloth_m * folds
            whom = np.where(met < ranges_m, number, whom)
            ranges_m = np.minimum(ranges_m, met)
    return ranges_m, whom


def before_background(
    scan: Scan, person: Person, row: int, noise_m: float, random: np.random.Generator
) -> tuple[Scan, NDArray[np.bool_]]:
    """A real scan with a person before what it met, and which beams met the person."""
    beams = np.column_stack([np.cos(scan.angles_rad), np.sin(scan.angles_rad)])
    met_m = np.where(scan.is_return, scan.ranges_m, np.inf).astype(np.float64)
    ranges_m, whom = with_persons(met_m, (person,), np.zeros(2), beams, row, random)
    is_met = whom != NOBODY
    noisy_m = ranges_m + random.normal(0, noise_m, len(ranges_m))
    return replace(scan, ranges_m=np.where(is_met, noisy_m, scan.ranges_m).astype(np.float32)), is_met


def measured(true_m: Floats, laser: Laser, random: np.random.Generator) -> NDArray[np.float32]:
    """(n,) what the sensor says; infinite where nothing came back."""
    ranges = np.minimum(true_m, 2 * laser.range_max_m)
    beyond = np.append(ranges[1:], ranges[-1])
    is_mixed = (np.abs(beyond - ranges) > 0.1) & (random.random(len(ranges)) < laser.mixed)
    ranges = ranges + np.where(is_mixed, random.random(len(ranges)), 0.0) * (beyond - ranges)
    ranges = ranges + random.normal(0, 1, len(ranges)) * (laser.noise_m + laser.noise_share * ranges)
    ranges = np.round(ranges / laser.quantum_m) * laser.quantum_m
    is_lost = (random.random(len(ranges)) < laser.lost) | (ranges < 0.03) | (ranges > laser.range_max_m)
    return np.where(is_lost, np.inf, ranges).astype(np.float32)


def row_at(time_s: float) -> int:
    return int(time_s / STEP_S)


def _to_ellipse(at_m: Floats, beams: Floats, middle_m: Floats, turn_rad: float, axes_m: Floats) -> Floats:
    """(n,) how far along each beam an ellipse is; infinite where it is not met."""
    cosine, sine = math.cos(turn_rad), math.sin(turn_rad)
    turned = np.array([[cosine, sine], [-sine, cosine]]) / axes_m[:, None]
    start = turned @ (at_m - middle_m)
    rays = beams @ turned.T
    square = (rays**2).sum(axis=1)
    half = rays @ start
    root = half**2 - square * (start @ start - 1)
    along = (-half - np.sqrt(np.maximum(root, 0))) / square
    met: Floats = np.where((root >= 0) & (along > 0), along, np.inf)
    return met
