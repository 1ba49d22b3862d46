"""Walking: where the shins are and in which phase of the gait a body is, from how its middle moves.

Steps follow from speed by the walk ratio: step length over cadence is nearly constant for one person, about
0.0065 m per (step/min) (Sekiya and Nagasaki 1998), so that v = step length * cadence gives both.
In the phases of Perry 1992 a foot is on the floor for 60 % of its stride: the other swings during the middle
80 % of a step. A foot comes down where the body will be in the middle of the stance that begins then, half a
hip's width to its side. What a 2D laser sees is the shin just above the ankle: it stands still in stance (the
few centimetres by which the shin rocks over the foot are not modelled) and swings half a cosine forward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from semap_ingest.simulation.motion import STEP_S, Motion

WALK_RATIO_MMIN = 0.0065
FEET_APART_M = 0.2
TURN_PER_STEP_RAD = 0.6
SWING_SHARE = 0.8
FULL_STRIDE_MPS = 1.2
AT_REST = 1e-3
"""Speeds [m/s, rad/s] below it are standing."""

LEFT, RIGHT = 0, 1


@dataclass(frozen=True, eq=False)
class Gait:
    """shins_m (n, 2, 2): left, right; phase_rad (n,) grows, a multiple of pi at heel strike; swing (n,)"""

    shins_m: NDArray[np.float64]
    phase_rad: NDArray[np.float64]
    swing: NDArray[np.float64]


def gait(motion: Motion) -> Gait:
    """The gait of samples from time 0 on.

    During phase 0 to pi the right foot swings, during pi to 2 pi the left one.
    """
    speed_mps = np.gradient(motion.position_m, STEP_S, axis=0)
    speed_mps = np.hypot(speed_mps[:, 0], speed_mps[:, 1])
    turn_radps = np.abs(np.gradient(motion.heading_rad, STEP_S))
    step_hz = np.maximum(np.sqrt(speed_mps / (60 * WALK_RATIO_MMIN)), turn_radps / TURN_PER_STEP_RAD)
    moves = (speed_mps > AT_REST) | (turn_radps > AT_REST)
    steps = _steps(step_hz, moves)
    count = len(motion)
    shins = np.stack([_foothold(motion, side, 0.0) for side in (LEFT, RIGHT)])
    shins_m = np.repeat(shins[None], count, axis=0)
    phase_rad = np.zeros(count)
    for number, (begin, end) in enumerate(steps):
        begin_index, end_index = math.ceil(begin), math.ceil(end)
        inside = (np.arange(begin_index, end_index) - begin) / (end - begin)
        phase_rad[begin_index:end_index] = math.pi * (number + inside)
        phase_rad[end_index:] = math.pi * (number + 1)
        side = RIGHT if number % 2 == 0 else LEFT
        following = steps[number + 1] if number + 1 < len(steps) else (end, end)
        stance_end = following[1] if following[0] <= end + 1 else end
        landing_m = _foothold(motion, side, (end + stance_end) / 2)
        swung = np.clip((inside - (1 - SWING_SHARE) / 2) / SWING_SHARE, 0.0, 1.0)
        share = (1 - np.cos(math.pi * swung)) / 2
        from_m = shins_m[begin_index - 1, side] if begin_index else shins_m[0, side]
        shins_m[begin_index:end_index, side] = from_m + share[:, None] * (landing_m - from_m)
        shins_m[end_index:, side] = landing_m
    smooth = np.convolve(np.pad(speed_mps, 15, mode="edge"), np.ones(31) / 31, mode="valid")
    return Gait(shins_m, phase_rad, np.clip(smooth / FULL_STRIDE_MPS, 0.0, 1.0))


def _steps(step_hz: NDArray[np.float64], moves: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Beginning and end of each step [samples]: a whole number of them in each stretch of movement."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moves.astype(np.int8), [0]])))
    steps: list[tuple[float, float]] = []
    for first, last in edges.reshape(-1, 2):
        begun = np.concatenate([[0.0], np.cumsum(step_hz[first:last]) * STEP_S])
        whole = max(2, round(begun[-1]))
        bounds = np.interp(np.arange(whole + 1) / whole * begun[-1], begun, np.arange(first, last + 1))
        steps += [(float(begin), float(end)) for begin, end in pairwise(bounds)]
    return steps


def _foothold(motion: Motion, side: int, sample: float) -> NDArray[np.float64]:
    """(2,) where a foot stands beside the body [m, map]."""
    index = min(round(sample), len(motion) - 1)
    heading_rad = motion.heading_rad[index]
    to_left = np.array([-math.sin(heading_rad), math.cos(heading_rad)])
    beside: NDArray[np.float64] = to_left * (FEET_APART_M / 2 if side == LEFT else -FEET_APART_M / 2)
    foothold_m: NDArray[np.float64] = motion.position_m[index] + beside
    return foothold_m
