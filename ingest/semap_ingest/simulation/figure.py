"""The shape of a simulated person: an articulated figure of spheres and the hulls around them.

Joint heights and lengths of limbs are fractions of the body's height after Winter, Biomechanics and Motor
Control of Human Movement, 4th edition, figure 4.1. The feet stand straight below the shins that a laser would
see, knees bend forward as far as the hips are too low for straight legs, arms swing against the legs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.simulation.moment import Body

Floats = NDArray[np.float64]

HAIR, SKIN, TOP, TROUSERS, SHOE, SLEEVE = range(6)
"""Places in `Figures.colour`."""

SPHERES = (
    "hip", "knee", "ankle", "heel", "toe", "pelvis", "chest", "shoulder", "elbow", "wrist", "hand",
)  # fmt: skip
"""Each twice, left and right, in this order; after them those in the middle."""
MIDDLE = ("neck", "jaw", "crown", "hair")

_SIDED = {name: 2 * k for k, name in enumerate(SPHERES)}
_CENTRAL = {name: 2 * len(SPHERES) + k for k, name in enumerate(MIDDLE)}


@dataclass(frozen=True)
class Part:
    """The hull of some spheres, in one colour."""

    name: str
    spheres: tuple[int, ...]
    colour: int


def _limbs(name: str, ends: tuple[str, ...], colour: int) -> tuple[Part, Part]:
    left, right = (tuple(_SIDED[end] + side for end in ends) for side in (0, 1))
    return Part(f"left {name}", left, colour), Part(f"right {name}", right, colour)


PARTS: tuple[Part, ...] = (
    *_limbs("thigh", ("hip", "knee"), TROUSERS),
    *_limbs("shank", ("knee", "ankle"), TROUSERS),
    *_limbs("foot", ("ankle", "heel", "toe"), SHOE),
    Part(
        "torso",
        tuple(_SIDED[name] + side for name in ("pelvis", "chest", "shoulder") for side in (0, 1)),
        TOP,
    ),
    *_limbs("upper arm", ("shoulder", "elbow"), TOP),
    *_limbs("forearm", ("elbow", "wrist"), SLEEVE),
    *_limbs("hand", ("wrist", "hand"), SKIN),
    Part("neck", (_CENTRAL["neck"], _CENTRAL["jaw"]), SKIN),
    Part("head", (_CENTRAL["jaw"], _CENTRAL["crown"]), SKIN),
    Part("hair", (_CENTRAL["hair"],), HAIR),
)

SPHERE_COUNT = 2 * len(SPHERES) + len(MIDDLE)


@dataclass(frozen=True, eq=False)
class Figures:
    """The spheres of b persons.

    centre_m  (b, SPHERE_COUNT, 3) [m, map]
    radius_m  (b, SPHERE_COUNT)
    colour    (b, 6, 3) float64 0 to 255, red first, by HAIR ... SLEEVE
    """

    centre_m: Floats
    radius_m: Floats
    colour: Floats


def figures(bodies: Sequence[Body]) -> Figures:
    """How the bodies stand and walk; the floor is at z 0."""
    count = len(bodies)
    centre = np.zeros((count, SPHERE_COUNT, 3))
    radius = np.zeros((count, SPHERE_COUNT))
    if count == 0:
        return Figures(centre, radius, np.zeros((0, 6, 3)))
    height, width, depth, heading, phase, swing, shin = np.array(
        [
            (b.height_m, b.width_m, b.depth_m, b.heading_rad, b.phase_rad, b.swing, b.shin_radius_m)
            for b in bodies
        ]
    ).T
    stand = np.zeros((count, 3))
    stand[:, :2] = [body.position_m for body in bodies]
    forward = np.column_stack([np.cos(heading), np.sin(heading), np.zeros(count)])
    left = np.column_stack([-np.sin(heading), np.cos(heading), np.zeros(count)])
    shins = np.array([body.shins_m for body in bodies], np.float64)
    reach = np.einsum("bsk,bk->bs", shins - stand[:, None, :2], forward[:, :2])
    hips_z = _pose_legs(centre, stand, forward, left, shins, _lift(phase, swing), height)
    _pose_trunk(centre, stand, forward, left, hips_z, height, width)
    _pose_arms(centre, forward, left, reach[:, ::-1], height)
    _give_girth(radius, height, depth, shin)
    return Figures(centre, radius, _colours(bodies))


def _lift(phase: Floats, swing: Floats) -> Floats:
    """(b, 2), how far each ankle is raised while its foot swings [m]."""
    wave = np.sin(phase)
    lift: Floats = 0.07 * swing[:, None] * np.maximum(np.column_stack([-wave, wave]), 0.0)
    return lift


def _pose_legs(
    centre: Floats, stand: Floats, forward: Floats, left: Floats, shins: Floats, lift: Floats, height: Floats
) -> Floats:
    """Hips, knees and feet; gives the height of the hips (b,) [m], which sink as the feet are apart."""
    thigh, shank = 0.245 * height, 0.246 * height
    sides = left[:, None, :] * np.array([[1.0], [-1.0]])
    ankle = np.concatenate([shins, (0.039 * height[:, None] + lift)[..., None]], axis=2)
    hip = stand[:, None, :] + 0.045 * height[:, None, None] * sides
    apart = np.linalg.norm(ankle[..., :2] - hip[..., :2], axis=2)
    span = 0.999 * (thigh + shank)
    rise = np.sqrt(np.maximum(span[:, None] ** 2 - apart**2, (0.3 * span[:, None]) ** 2))
    hips_z: Floats = np.minimum(0.53 * height, (ankle[..., 2] + rise).min(axis=1))
    hip[..., 2] = hips_z[:, None]
    knee = _knee(hip, ankle, forward, thigh, shank)
    sole = ankle - np.array([0.0, 0.0, 1.0]) * (0.014 * height[:, None, None])
    heel = sole - 0.025 * height[:, None, None] * forward[:, None, :]
    toe = sole + 0.085 * height[:, None, None] * forward[:, None, :]
    toe[..., 2] -= 0.6 * np.minimum(lift, 0.03)
    for name, points in (("hip", hip), ("knee", knee), ("ankle", ankle), ("heel", heel), ("toe", toe)):
        centre[:, _SIDED[name] : _SIDED[name] + 2] = points
    return hips_z


def _knee(hip: Floats, ankle: Floats, forward: Floats, thigh: Floats, shank: Floats) -> Floats:
    """(b, 2, 3), where circles around hip and ankle meet in front of the leg."""
    way = ankle - hip
    length = np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-6)
    along = way / length
    thigh, shank = thigh[:, None, None], shank[:, None, None]
    foot_point = np.clip((thigh**2 - shank**2 + length**2) / (2 * length), 0.0, thigh)
    bend = forward[:, None, :] - np.einsum("bsk,bk->bs", along, forward)[..., None] * along
    bend /= np.maximum(np.linalg.norm(bend, axis=2, keepdims=True), 1e-6)
    knee: Floats = hip + foot_point * along + np.sqrt(thigh**2 - foot_point**2) * bend
    return knee


def _pose_trunk(
    centre: Floats,
    stand: Floats,
    forward: Floats,
    left: Floats,
    hips_z: Floats,
    height: Floats,
    width: Floats,
) -> None:
    sink = hips_z - 0.53 * height

    def at(up: float, ahead: float = 0.0, aside: Floats | float = 0.0) -> Floats:
        point = stand + ahead * height[:, None] * forward + np.asarray(aside)[..., None] * left
        point[:, 2] = up * height + sink
        return point

    arm = 0.03 * height
    for name, up, aside in (
        ("pelvis", 0.55, 0.05 * height),
        ("chest", 0.72, np.maximum(0.5 * width - 3.4 * arm, 0.02)),
        ("shoulder", 0.80, 0.5 * width - arm),
    ):
        for side, sign in enumerate((1.0, -1.0)):
            centre[:, _SIDED[name] + side] = at(up, 0.0, sign * aside)
    centre[:, _CENTRAL["neck"]] = at(0.83)
    centre[:, _CENTRAL["jaw"]] = at(0.895, 0.018)
    centre[:, _CENTRAL["crown"]] = at(0.938, 0.006)
    centre[:, _CENTRAL["hair"]] = at(0.946, -0.010)


def _pose_arms(centre: Floats, forward: Floats, left: Floats, reach: Floats, height: Floats) -> None:
    """reach  (b, 2), how far ahead the foot of the other side is [m]: the arm goes with it."""
    shoulder = centre[:, _SIDED["shoulder"] : _SIDED["shoulder"] + 2]
    out = left[:, None, :] * np.array([[0.06], [-0.06]])
    upper = np.clip(1.3 * reach, -0.7, 0.7)[..., None]
    lower = upper + 0.25 + 0.4 * np.maximum(upper, 0.0)
    down = np.array([0.0, 0.0, -1.0])
    length = height[:, None, None]
    elbow = shoulder + 0.17 * length * (np.sin(upper) * forward[:, None] + np.cos(upper) * down + out)
    lower_way = np.sin(lower) * forward[:, None] + np.cos(lower) * down
    wrist = elbow + 0.14 * length * lower_way
    for name, points in (("elbow", elbow), ("wrist", wrist), ("hand", wrist + 0.05 * length * lower_way)):
        centre[:, _SIDED[name] : _SIDED[name] + 2] = points


def _give_girth(radius: Floats, height: Floats, depth: Floats, shin: Floats) -> None:
    girth: dict[str, Floats] = {
        "hip": 0.046 * height,
        "knee": 1.05 * shin,
        "ankle": 0.72 * shin,
        "heel": 0.024 * height,
        "toe": 0.022 * height,
        "pelvis": 0.40 * depth,
        "chest": 0.46 * depth,
        "shoulder": 0.030 * height,
        "elbow": 0.026 * height,
        "wrist": 0.020 * height,
        "hand": 0.022 * height,
    }
    for name, of_sphere in girth.items():
        radius[:, _SIDED[name] : _SIDED[name] + 2] = of_sphere[:, None]
    for name, share in (("neck", 0.033), ("jaw", 0.040), ("crown", 0.052), ("hair", 0.054)):
        radius[:, _CENTRAL[name]] = share * height


def _colours(bodies: Sequence[Body]) -> Floats:
    clothes = np.array([body.clothes for body in bodies], np.float64)
    shoe = 0.45 * clothes[:, TROUSERS] + 10.0
    # long or short sleeves: nothing says which, and it should not change from frame to frame
    is_short = clothes.sum(axis=(1, 2)) % 3 == 0
    sleeve = np.where(is_short[:, None], clothes[:, SKIN], clothes[:, TOP])
    return np.concatenate([clothes, shoe[:, None], sleeve[:, None]], axis=1)
