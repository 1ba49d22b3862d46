"""A plain ray caster: what a 2D laser at a pose measures of upright segments."""

from __future__ import annotations

import math

import numpy as np
from semap_ingest.sensing.scan import Scan

BEAMS = 811
STEP_RAD = math.radians(270) / (BEAMS - 1)


def cast(segments, pose=(0.0, 0.0, 0.0), noise_m: float = 0.0, seed: int = 0, dropout: float = 0.0) -> Scan:
    """segments: ((x, y), (x, y)) in the map; pose: x, y [m], yaw [rad]."""
    x, y, yaw = pose
    dice = np.random.default_rng(seed)
    angles = -math.radians(135) + STEP_RAD * np.arange(BEAMS)
    ranges = np.full(BEAMS, np.inf)
    for (ax, ay), (bx, by) in segments:
        dx, dy = np.cos(angles + yaw), np.sin(angles + yaw)
        ex, ey = bx - ax, by - ay
        det = dx * -ey + dy * ex
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (-(ax - x) * ey + (ay - y) * ex) / det
            s = (dx * (ay - y) - dy * (ax - x)) / det
        hit = (np.abs(det) > 1e-12) & (t > 0) & (s >= 0) & (s <= 1)
        ranges = np.where(hit & (t < ranges), t, ranges)
    ranges = ranges + dice.normal(0, noise_m, BEAMS) if noise_m else ranges
    ranges[dice.random(BEAMS) < dropout] = 0.0
    return Scan(5, "laser", -math.radians(135), STEP_RAD, 0.05, 25.0, ranges.astype(np.float32))


def polygon(corners):
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))
