"""Where rays on the plan first meet segments and circles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def to_segments(from_m: Floats, rays: Floats, segments_m: Floats) -> Floats:
    """(n,) how far along each of (n, 2) unit vectors the nearest segment is; infinite where there is none.

    segments_m  (m, 2, 2) for all rays, or (n, m, 2, 2) for each its own
    """
    if segments_m.ndim == 3:
        segments_m = segments_m[None]
    begin = segments_m[:, :, 0] - from_m
    edge = segments_m[:, :, 1] - segments_m[:, :, 0]
    ray = rays[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        across = cross(ray, edge)
        distance_m = cross(begin, edge) / across
        along = cross(begin, ray) / across
        is_met = (distance_m > 0) & (along >= 0) & (along <= 1)
    nearest: Floats = np.min(np.where(is_met, distance_m, np.inf), axis=1, initial=np.inf)
    return nearest


def to_circles(from_m: Floats, rays: Floats, middles_m: Floats, radius_m: float) -> Floats:
    """(n,) how far along each of (n, 2) unit vectors the nearest circle is; infinite where there is none.

    middles_m  (m, 2) for all rays, or (n, m, 2) for each its own
    """
    to_middle = middles_m - from_m
    ray = rays[:, None]
    ahead = np.sum(to_middle * ray, axis=-1)
    square = ahead**2 - np.sum(to_middle**2, axis=-1) + radius_m**2
    distance_m = ahead - np.sqrt(np.maximum(square, 0.0))
    is_met = (square >= 0) & (distance_m > 0)
    nearest: Floats = np.min(np.where(is_met, distance_m, np.inf), axis=1, initial=np.inf)
    return nearest


def is_crossed(from_m: Floats, to_m: Floats, segments_m: Floats) -> NDArray[np.bool_]:
    """(n,), whether the line from one point to each of (n, 2) others crosses any of (m, 2, 2) segments."""
    ray = to_m - from_m
    length_m = np.linalg.norm(ray, axis=1)
    crossed: NDArray[np.bool_] = (
        to_segments(from_m, ray / np.maximum(length_m, 1e-9)[:, None], segments_m) < length_m
    )
    return crossed


def is_near(from_m: Floats, to_m: Floats, middles_m: Floats, radius_m: float) -> NDArray[np.bool_]:
    """(n,), whether the line from a point to each of (n, 2) others comes near the middle in the same row."""
    ray = to_m - from_m
    square = np.maximum(np.sum(ray**2, axis=1), 1e-12)
    along = np.clip(np.sum((middles_m - from_m) * ray, axis=1) / square, 0.0, 1.0)
    near: NDArray[np.bool_] = np.linalg.norm(middles_m - from_m - along[:, None] * ray, axis=1) < radius_m
    return near


def cross(first: Floats, second: Floats) -> Floats:
    """The z of the product of vectors (..., 2)."""
    product: Floats = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return product
