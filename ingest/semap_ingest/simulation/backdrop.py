"""What a simulated camera sees without persons: walls, leaves, furniture, floor and ceiling, by casting rays.

Each upright rectangle is met with the rays of the pixels that it may cover; the nearest wins. Looks are made
up (light, waves in the paint, skirting boards, pictures, tiles), so that the image is not trivially clean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from semap_ingest.simulation.lens import Lens
from semap_ingest.simulation.moment import Surfaces

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

NEAREST_M = 0.05


@dataclass(frozen=True, eq=False)
class Sight:
    """A camera at its place.

    origin_m    (3,) [m, map]
    turn        (3, 3), the rotation in map_T_camera
    directions  (height, width, 3) float32 [map]: rays as long as it takes for 1 along the optical axis
    vignette    (height, width) float32, how bright the lens is, darker towards the corners
    """

    lens: Lens
    origin_m: Floats
    turn: Floats
    directions: Floats32
    vignette: Floats32

    def to_camera(self, points_m: Floats) -> Floats:
        """(..., 3) points in the map, in the optical frame."""
        turned: Floats = (points_m - self.origin_m) @ self.turn
        return turned


@dataclass(frozen=True, eq=False)
class Layer:
    """What is drawn so far.

    pixels   (height, width, 3) uint8, red first
    depth_m  (height, width) float32 along the optical axis; infinite on floor and ceiling, which hide nobody
    """

    pixels: NDArray[np.uint8]
    depth_m: Floats32


@dataclass(frozen=True, eq=False)
class Picture:
    """A poster on a wall.

    place_m  left, bottom, width, height on the wall
    pixels   (k, l, 3), the lowest row first
    """

    place_m: tuple[float, float, float, float]
    pixels: Floats32


@dataclass(frozen=True, eq=False)
class Decoration:
    """Made-up looks, the same wherever the camera stands.

    light     (2,) direction on the plan from which it is brighter
    waves     (n, 4) wave numbers [1/m] and phases of the paint of each surface
    pictures  by the number of the surface
    floor, ceiling  (3,) colours
    vignette  how much darker the lens is in the corners
    """

    light: Floats
    waves: Floats
    pictures: Mapping[int, tuple[Picture, ...]]
    floor: Floats
    ceiling: Floats
    tile_m: float
    vignette: float


def sight(lens: Lens, map_T_camera: Floats, vignette: float) -> Sight:
    """vignette  how much darker the corners of the image are, 0 to 1"""
    turn = np.asarray(map_T_camera[:3, :3], np.float64)
    directions = lens.rays @ turn[:, :2].T.astype(np.float32) + turn[:, 2].astype(np.float32)
    radius2 = (lens.rays**2).sum(axis=2)
    bright = (1 - vignette * radius2 / radius2.max()).astype(np.float32)
    return Sight(lens, np.asarray(map_T_camera[:3, 3], np.float64), turn, directions, bright)


def decorate(surfaces: Surfaces, generator: np.random.Generator) -> Decoration:
    count = len(surfaces.segments_m)
    angle = generator.uniform(0, 2 * np.pi)
    waves = np.column_stack([generator.uniform(0.8, 4.0, (count, 2)), generator.uniform(0, 6.3, (count, 2))])
    lengths = np.linalg.norm(surfaces.segments_m[:, 1] - surfaces.segments_m[:, 0], axis=1)
    is_wall = (lengths > 1.0) & (surfaces.z_m[:, 0] < 0.05) & (surfaces.z_m[:, 1] > 2.0)
    pictures: dict[int, tuple[Picture, ...]] = {}
    for k in np.flatnonzero(is_wall):
        number = int(generator.integers(0, 1 + min(3, int(lengths[k]))))
        if number:
            pictures[int(k)] = tuple(_picture(float(lengths[k]), generator) for _ in range(number))
    return Decoration(
        np.array([np.cos(angle), np.sin(angle)]),
        waves,
        pictures,
        generator.uniform(70, 170) + generator.uniform(-18, 18, 3),
        generator.uniform(190, 240) + generator.uniform(-8, 8, 3),
        float(generator.choice([0.3, 0.5, 0.6, 1.0])),
        float(generator.uniform(0.05, 0.3)),
    )


def _picture(length_m: float, generator: np.random.Generator) -> Picture:
    width = min(generator.uniform(0.3, 1.0), 0.8 * length_m)
    height = generator.uniform(0.3, 1.3)
    left = generator.uniform(0, length_m - width)
    bottom = generator.uniform(0.75, 1.6)
    # low frequencies first: areas of colour with some detail on them, some of them as upright as a person
    rough = generator.uniform(20, 235, (*generator.integers(2, 6, 2), 3)).astype(np.float32)
    manner = int(generator.choice([cv2.INTER_NEAREST, cv2.INTER_LINEAR]))
    pixels = np.asarray(cv2.resize(rough, (24, 32), interpolation=manner), np.float32)
    pixels[[0, -1]] = pixels[:, [0, -1]] = generator.uniform(10, 245)
    return Picture((float(left), float(bottom), float(width), float(height)), pixels)


def rooms(view: Sight, surfaces: Surfaces, decoration: Decoration) -> Layer:
    """Floor, ceiling and all that never moves."""
    pixels = _seen(_floor_and_ceiling(view, surfaces, decoration), view.vignette)
    layer = Layer(pixels, np.full(pixels.shape[:2], np.inf, np.float32))
    _cast(view, surfaces, decoration, layer)
    return layer


def with_leaves(view: Sight, behind: Layer, leaves: Surfaces) -> Layer:
    """The layer with the leaves of doors as they stand."""
    layer = Layer(behind.pixels.copy(), behind.depth_m.copy())
    _cast(view, leaves, None, layer)
    return layer


def _seen(colour: Floats32, bright: Floats32) -> NDArray[np.uint8]:
    pixels: NDArray[np.uint8] = np.clip(colour * bright[..., None], 0, 255).astype(np.uint8)
    return pixels


def _cast(view: Sight, surfaces: Surfaces, decoration: Decoration | None, layer: Layer) -> None:
    """Draw the surfaces where they are nearer than what is there; without decoration as leaves of doors."""
    corners = _corners(view, surfaces)
    nearest = corners[..., 2].min(axis=1)
    for k in np.argsort(nearest, kind="stable"):
        window = _window(view.lens, corners[k])
        ends = surfaces.segments_m[k]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if window is None or length < 1e-6 or not (layer.depth_m[window] > nearest[k]).any():
            continue
        along = (ends[1] - ends[0]) / length
        way, at, up = _meet(view, window, ends[0], along)
        low, high = surfaces.z_m[k]
        with np.errstate(invalid="ignore"):
            is_hit = (way > NEAREST_M) & (way < layer.depth_m[window])
            is_hit &= (at >= 0) & (at <= length) & (up >= low) & (up <= high)
        at, up, way = at[is_hit], up[is_hit], way[is_hit]
        base = surfaces.colour[k].astype(np.float32)
        if decoration is None:
            colour = _leaf_colour(base, at, up, length, along)
        else:
            colour = _wall_colour(base, at, up, way, int(k), surfaces, along, decoration)
        layer.depth_m[window][is_hit] = way
        layer.pixels[window][is_hit] = _seen(colour, view.vignette[window][is_hit])


def _corners(view: Sight, surfaces: Surfaces) -> Floats:
    """(n, 4, 3) [optical frame]"""
    ends, heights = surfaces.segments_m, surfaces.z_m
    corners = np.empty((len(ends), 4, 3))
    for k, (end, edge) in enumerate(((0, 0), (1, 0), (1, 1), (0, 1))):
        corners[:, k, :2] = ends[:, end]
        corners[:, k, 2] = heights[:, edge]
    return view.to_camera(corners)


def _window(lens: Lens, corners: Floats) -> tuple[slice, slice] | None:
    """The rows and columns whose rays may meet a rectangle; None: out of sight."""
    in_front = []
    for k in range(4):
        start, end = corners[k - 1], corners[k]
        if (start[2] > NEAREST_M) != (end[2] > NEAREST_M):
            share = (NEAREST_M - start[2]) / (end[2] - start[2])
            in_front.append(start + share * (end - start))
        if end[2] > NEAREST_M:
            in_front.append(end)
    if not in_front:
        return None
    points = np.array(in_front)
    plane = points[:, :2] / np.maximum(points[:, 2:], NEAREST_M)
    low, high = plane.min(axis=0) - 1e-3, plane.max(axis=0) + 1e-3
    columns, rows = _span(lens.columns, low[0], high[0]), _span(lens.rows, low[1], high[1])
    return None if rows is None or columns is None else (rows, columns)


def _span(ranges: Floats32, low: float, high: float) -> slice | None:
    touched = np.flatnonzero((ranges[:, 1] >= low) & (ranges[:, 0] <= high))
    return slice(int(touched[0]), int(touched[-1]) + 1) if len(touched) else None


def _meet(
    view: Sight, window: tuple[slice, slice], start: Floats, along: Floats
) -> tuple[Floats32, Floats32, Floats32]:
    """Depth, place along the surface and height above the floor [m] where rays meet an upright plane."""
    rays = view.directions[window]
    ahead = start - view.origin_m[:2]
    along32 = along.astype(np.float32)
    offset = np.float32(-along[1] * ahead[0] + along[0] * ahead[1])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        way = offset / (along32[0] * rays[..., 1] - along32[1] * rays[..., 0])
        at = way * (along32[0] * rays[..., 0] + along32[1] * rays[..., 1]) - np.float32(ahead @ along)
        up = way * rays[..., 2] + np.float32(view.origin_m[2])
    return way, at, up


def _wall_colour(
    base: Floats32,
    at: Floats32,
    up: Floats32,
    way: Floats32,
    k: int,
    surfaces: Surfaces,
    along: Floats,
    decoration: Decoration,
) -> Floats32:
    wave = decoration.waves[k].astype(np.float32)
    bright = 1 + 0.05 * np.sin(wave[0] * at + wave[2]) * np.sin(wave[1] * up + wave[3])
    bright *= 0.72 + 0.25 * abs(float(along[1] * decoration.light[0] - along[0] * decoration.light[1]))
    bright += 0.04 * (up - 1.2)
    if surfaces.z_m[k, 0] < 0.05 and surfaces.z_m[k, 1] > 2.0:
        bright = np.where(up < 0.09, 0.55 * bright, bright)
    colour = np.broadcast_to(base, (len(at), 3)).copy()
    for picture in decoration.pictures.get(k, ()):
        left, bottom, width, height = picture.place_m
        column, row = (at - left) / width, (up - bottom) / height
        is_on = (column >= 0) & (column < 1) & (row >= 0) & (row < 1)
        rows, columns = picture.pixels.shape[:2]
        colour[is_on] = picture.pixels[(row[is_on] * rows).astype(int), (column[is_on] * columns).astype(int)]
    colour *= (bright * np.clip(1.08 - 0.025 * way, 0.6, 1.0))[:, None]
    return colour


def _leaf_colour(base: Floats32, at: Floats32, up: Floats32, length: float, along: Floats) -> Floats32:
    bright = np.full(len(at), 0.82 + 0.16 * abs(float(along[0])), np.float32)
    inset = np.minimum(np.minimum(at, length - at), np.minimum(up - 0.15, 1.9 - up))
    bright[(inset > 0.12) & (inset < 0.14)] *= 0.75
    bright[(np.abs(up - 1.03) < 0.02) & (length - at > 0.05) & (length - at < 0.17)] *= 0.35
    return bright[:, None] * base


def _floor_and_ceiling(view: Sight, surfaces: Surfaces, decoration: Decoration) -> Floats32:
    height = float(surfaces.z_m.max()) if len(surfaces.z_m) else 2.6
    rays = view.directions
    is_floor = rays[..., 2] < 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        way = np.where(is_floor, -view.origin_m[2], height - view.origin_m[2]) / rays[..., 2]
        way = np.clip(np.nan_to_num(way, nan=1e3), 0.0, 1e3).astype(np.float32)
    x = way * rays[..., 0] + np.float32(view.origin_m[0])
    y = way * rays[..., 1] + np.float32(view.origin_m[1])
    # fine patterns fade with distance, as a lens blurs them
    fade = np.exp(-way / 6)
    tile = np.where(is_floor, decoration.tile_m, 0.6).astype(np.float32)
    column, row = x / tile, y / tile
    edge = np.minimum(np.abs(column - np.round(column)), np.abs(row - np.round(row))) * tile
    checker = (np.floor(column) + np.floor(row)) % 2
    bright = 1 + fade * (0.06 * (checker - 0.5) - np.where(edge < 0.012, 0.22, 0.0))
    bright *= 1 + 0.08 * np.sin(0.9 * x + 1.3) * np.sin(0.7 * y)
    is_lamp = ~is_floor & (np.floor(column) % 4 == 0) & (np.floor(row) % 3 == 0)
    colour = np.where(is_floor[..., None], decoration.floor, decoration.ceiling) * bright[..., None]
    colour[is_lamp] = 252
    colour *= np.clip(1.05 - 0.03 * way, 0.55, 1.0)[..., None]
    painted: Floats32 = colour.astype(np.float32)
    return painted
