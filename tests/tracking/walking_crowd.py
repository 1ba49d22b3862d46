"""People who walk about in a hall, and what a robot at its edge makes of them: scenes with known truth.

Each walks to one place after the other, speeds up, slows down and turns as people do (at most 2.5 m/s^2), stands
for a while, and gives way to others. The middle of the legs sways with the steps. Who stands behind another is
not seen; detections are missed, are of one sensor or of both, and some are of nobody.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from semap_ingest.sensing.detections import BOTH, CAMERA, LASER, Detections
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.tracking.map_tracker import MapTracker
from semap_service.evaluation.mot_scores import Places

Floats = NDArray[np.float64]

ROBOT_M = np.array([0.0, 6.0])
STEP_HZ = 1.8
SUBSTEPS = 4


@dataclass(frozen=True)
class Crowd:
    """How the scene is made."""

    people: int = 5
    seconds: float = 30.0
    rate_hz: float = 15.0
    hall_m: tuple[float, float] = (12.0, 12.0)
    missed: float = 0.05
    clutter: float = 0.3
    steady_clutter: int = 3
    occlusion: bool = True
    images_swap: float = 0.0


@dataclass(frozen=True, eq=False)
class Scene:
    """position_m, velocity_mps (frames, people, 2), is_visible (frames, people), frames of detections, and whom each
    detection shows (-1: nobody)"""

    stamp_us: NDArray[np.int64]
    position_m: Floats
    velocity_mps: Floats
    is_visible: NDArray[np.bool_]
    frames: list[Detections]
    shows: list[NDArray[np.int64]]

    def truth(self, is_counted: NDArray[np.bool_]) -> Places:
        frame, person = np.nonzero(is_counted)
        return Places(self.stamp_us[frame], person, self.position_m[frame, person])


def detections(
    stamp_us: int,
    position_m: object,
    std_m: float = 0.05,
    score: object = 0.95,
    seen_by: object = BOTH,
    hint: object = -1,
    frame: str = "map",
) -> Detections:
    """A frame of equally exact detections; scalars hold for all."""
    place = np.asarray(position_m, np.float64).reshape(-1, 2)
    count = len(place)
    return Detections(
        stamp_us,
        frame,
        place,
        np.tile(std_m**2 * np.eye(2), (count, 1, 1)),
        np.broadcast_to(np.asarray(score, np.float64), count).copy(),
        np.broadcast_to(np.asarray(seen_by, np.uint8), count).copy(),
        np.full((count, 2), np.nan),
        np.broadcast_to(np.asarray(hint, np.int64), count).copy(),
    )


def shuffled(frame: Detections, order: NDArray[np.int64]) -> Detections:
    return replace(
        frame,
        position_m=frame.position_m[order],
        covariance_m2=frame.covariance_m2[order],
        score=frame.score[order],
        seen_by=frame.seen_by[order],
        extent_m=frame.extent_m[order],
        hint=frame.hint[order],
    )


def tracked(frames: list[Detections], tracker: MapTracker | None = None) -> list[TrackStates]:
    tracker = tracker or MapTracker()
    return [tracker.step(frame) for frame in frames]


def walk(crowd: Crowd, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Positions and velocities (frames, people, 2)."""
    hall = np.asarray(crowd.hall_m)
    frames, step_s = round(crowd.seconds * crowd.rate_hz), 1 / crowd.rate_hz / SUBSTEPS
    place = 0.5 + random.random((crowd.people, 2)) * (hall - 1)
    goal = 0.5 + random.random((crowd.people, 2)) * (hall - 1)
    speed = random.normal(1.2, 0.15, crowd.people)
    velocity, wait_s = np.zeros((crowd.people, 2)), np.zeros(crowd.people)
    places, velocities = np.empty((2, frames, crowd.people, 2))
    for frame in range(frames):
        for _ in range(SUBSTEPS):
            way = goal - place
            distance = np.hypot(*way.T)
            arrived = (distance < 0.4) & (wait_s <= 0)
            goal[arrived] = 0.5 + random.random((arrived.sum(), 2)) * (hall - 1)
            wait_s[arrived] = random.choice([0.0, 0.0, 2.0], arrived.sum())
            wait_s -= step_s
            wanted = np.where(wait_s > 0, 0.0, speed)[:, None] * way / np.maximum(distance, 1e-9)[:, None]
            push = (wanted - velocity) / 0.35 + _repulsion(place)
            strength = np.hypot(*push.T)
            velocity += push * np.minimum(1.0, 2.5 / np.maximum(strength, 1e-9))[:, None] * step_s
            place = place + velocity * step_s
        places[frame], velocities[frame] = place, velocity
    return places, velocities


def sway(position_m: Floats, velocity_mps: Floats, rate_hz: float, random: np.random.Generator) -> Floats:
    """Where the middle of the shins is: 13 cm along the way with each step, 2 cm across with each stride."""
    speed = np.linalg.norm(velocity_mps, axis=2)
    along = velocity_mps / np.maximum(speed, 1e-9)[..., None]
    across = np.stack([-along[..., 1], along[..., 0]], axis=2)
    phase = (
        2 * np.pi * random.random(speed.shape[1])
        + np.cumsum(np.full(len(speed), np.pi * STEP_HZ / rate_hz))[:, None]
    )
    swing = np.minimum(speed / 1.2, 1.0)[..., None]
    return position_m + swing * (
        0.13 * np.sin(2 * phase)[..., None] * along + 0.02 * np.sin(phase)[..., None] * across
    )


def scene(crowd: Crowd, seed: int) -> Scene:
    random = np.random.default_rng(seed)
    position, velocity = walk(crowd, random)
    legs = sway(position, velocity, crowd.rate_hz, random)
    is_visible = np.ones(position.shape[:2], np.bool_)
    if crowd.occlusion:
        is_visible = np.array([_visible(places) for places in position])
    stamp_us = np.round(np.arange(len(position)) * 1e6 / crowd.rate_hz).astype(np.int64)
    images = _images(is_visible, position, crowd, random)
    steady_m = random.random((crowd.steady_clutter, 2)) * crowd.hall_m
    frames, shows = [], []
    for frame, stamp in enumerate(stamp_us):
        who = np.flatnonzero(is_visible[frame] & (random.random(crowd.people) >= crowd.missed))
        made, whom = _seen(int(stamp), legs[frame], who, images[frame], steady_m, crowd, random)
        frames.append(made)
        shows.append(whom)
    return Scene(stamp_us, position, velocity, is_visible, frames, shows)


def _repulsion(place: Floats) -> Floats:
    offset = place[:, None, :] - place[None, :, :]
    distance = np.hypot(offset[..., 0], offset[..., 1])
    strength = np.where(
        (distance > 0) & (distance < 1.0), 6.0 * (1.0 - distance) / np.maximum(distance, 0.05), 0.0
    )
    return np.sum(strength[..., None] * offset, axis=1)


def _visible(places: Floats) -> NDArray[np.bool_]:
    offset = places - ROBOT_M
    distance, bearing = np.hypot(*offset.T), np.arctan2(offset[:, 1], offset[:, 0])
    apart = np.abs((bearing[:, None] - bearing[None, :] + np.pi) % (2 * np.pi) - np.pi)
    hides = (distance[None, :] < distance[:, None]) & (apart < 0.2 / np.maximum(distance, 0.3)[None, :])
    return ~hides.any(axis=1)


def _images(
    is_visible: NDArray[np.bool_], position: Floats, crowd: Crowd, random: np.random.Generator
) -> NDArray[np.int64]:
    """(frames, people) the image track of each: a new one after 1.5 s unseen, swapped now and then by two that
    come into sight of one another."""
    frames, people = is_visible.shape
    image, unseen = np.arange(1, people + 1), np.zeros(people, np.int64)
    images, next_image = np.empty((frames, people), np.int64), people + 1
    for frame in range(frames):
        unseen = np.where(is_visible[frame], unseen, unseen + 1)
        for person in np.flatnonzero(is_visible[frame] & (unseen > 0)):
            if unseen[person] > 1.5 * crowd.rate_hz:
                image[person], next_image = next_image, next_image + 1
            elif random.random() < crowd.images_swap:
                other = np.argsort(np.hypot(*(position[frame] - position[frame, person]).T))[1]
                image[[person, other]] = image[[other, person]]
            unseen[person] = 0
        images[frame] = image
    return images


def _seen(
    stamp_us: int,
    legs_m: Floats,
    who: NDArray[np.int64],
    image: NDArray[np.int64],
    steady_m: Floats,
    crowd: Crowd,
    random: np.random.Generator,
) -> tuple[Detections, NDArray[np.int64]]:
    by = random.choice(np.array([BOTH, LASER, CAMERA], np.uint8), len(who), p=[0.8, 0.1, 0.1])
    stray_m = random.random((random.poisson(crowd.clutter), 2)) * crowd.hall_m
    nobody_m = np.vstack([stray_m, steady_m[random.random(len(steady_m)) < 0.5]])
    false = len(nobody_m)
    centre_m = np.vstack([legs_m[who], nobody_m])
    covariance = np.tile(0.05**2 * np.eye(2), (len(centre_m), 1, 1))
    covariance[: len(who)][by == LASER] = 0.08**2 * np.eye(2)
    ray = legs_m[who] - ROBOT_M
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    along = ray[:, :, None] * ray[:, None, :]
    covariance[: len(who)][by == CAMERA] = (0.06**2 * np.eye(2) + (0.3**2 - 0.06**2) * along)[by == CAMERA]
    noise = np.linalg.cholesky(covariance) @ random.standard_normal((len(centre_m), 2, 1))
    made = Detections(
        stamp_us,
        "map",
        centre_m + noise[:, :, 0],
        covariance,
        np.concatenate([random.uniform(0.7, 0.99, len(who)), random.uniform(0.3, 0.6, false)]),
        np.concatenate([by, np.full(false, LASER, np.uint8)]),
        np.full((len(centre_m), 2), np.nan),
        np.concatenate([np.where(by == LASER, -1, image[who]), np.full(false, -1)]),
    )
    return made, np.concatenate([who, np.full(false, -1)])
