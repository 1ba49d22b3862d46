"""The image of a simulated camera, and the truth about the persons in it.

Rooms are cast once for a place of the camera (`backdrop`), leaves of doors when they move. Persons are drawn
as the hulls of their spheres (`figure`) seen through the lens, each part with one depth, which is compared
with what stands in the room and with the other persons. Then come blur, exposure and noise of the sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from semap_ingest.sensing.image import Camera
from semap_ingest.simulation.backdrop import Layer, Sight, decorate, rooms, sight, with_leaves
from semap_ingest.simulation.figure import PARTS, SPHERE_COUNT, Figures, figures
from semap_ingest.simulation.lens import lens_of
from semap_ingest.simulation.moment import Body, Moment, Surfaces

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]

NEAREST_M = 0.15
"""Parts of persons nearer than this are inside the camera and not drawn."""

_CORNERS = 12
_SHIFT = 4
"""Binary digits after the point in coordinates of OpenCV's polygons."""

_LIT = 0.62
"""Radius of the lit area of a limb, as a share of the limb's."""

_SPARE_PX = 64
"""How much larger than the image the patterns are that noise and cloth are cut from."""

_MEMBERS = np.zeros((len(PARTS), SPHERE_COUNT), np.bool_)
for _row, _part in zip(_MEMBERS, PARTS, strict=True):
    _row[list(_part.spheres)] = True


@dataclass(frozen=True, eq=False)
class View:
    """An image and the persons in it, those too that something hides.

    pixels      (height, width, 3) uint8, red first
    names       of the persons whose box reaches into the image
    corners_px  (n, 4) x_min, y_min, x_max, y_max of the whole figure, hidden or not, clipped to the image; a
                pixel's middle has whole numbers, as in CameraInfo
    visible     (n,) share of the figure's pixels in the image that show it
    """

    pixels: Pixels
    names: tuple[str, ...]
    corners_px: Floats
    visible: Floats


@dataclass(frozen=True, eq=False)
class _Outlines:
    """What persons would cover in the image.

    spheres_px  (b, SPHERE_COUNT, 2, corners, 2) outline and lit area of each sphere
    depth_m     (b, parts)
    is_drawn    (b, parts), whether all of the part is before the camera
    box_px      (b, 4), of all that is drawn, not clipped; from inf to -inf where nothing is
    """

    spheres_px: Floats
    depth_m: Floats
    is_drawn: NDArray[np.bool_]
    box_px: Floats


class CameraView:
    """A camera that stands somewhere in rooms.

    State: how the leaves stood last, drawn. The same calls give the same images, in any order.
    """

    def __init__(
        self, camera: Camera, map_T_camera: Floats, fixed: Surfaces, decoration: np.random.Generator
    ) -> None:
        """fixed       all that never moves
        decoration  makes up its looks: the same seed, the same looks
        raises      InvalidInput for a camera that `lens_of` refuses
        """
        self._decoration = decorate(fixed, decoration)
        self._sight = sight(lens_of(camera), map_T_camera, self._decoration.vignette)
        self._rooms = rooms(self._sight, fixed, self._decoration)
        grain = decoration.normal(0.0, 3.0, (camera.height_px + _SPARE_PX, camera.width_px + _SPARE_PX, 3))
        self._grain = np.round(grain).astype(np.int16)
        cloth = cv2.GaussianBlur(decoration.normal(0.0, 22.0, grain.shape[:2]), (0, 0), 1.2)
        self._cloth = np.repeat(np.round(cloth).astype(np.int16)[..., None], 3, axis=2)
        self._leaves: tuple[bytes, Layer] = (b"", self._rooms)

    def render(self, moment: Moment, leaves: Surfaces, noise: np.random.Generator) -> View:
        """What the camera sees; `leaves` are the surfaces that move, `noise` is of this image alone."""
        scene = self._with(leaves)
        pixels, depth = scene.pixels.copy(), scene.depth_m.copy()
        owner = np.full(depth.shape, -1, np.int16)
        people = figures(moment.bodies)
        outlines = _outlines(people, self._sight)
        windows = [_window(box, depth.shape) for box in outlines.box_px]
        for body, window in zip(moment.bodies, windows, strict=True):
            if window is not None:
                _shade_floor(pixels, depth, self._shadow_px(body))
        covered = np.zeros(len(windows))
        for k, window in enumerate(windows):
            if window is not None:
                covered[k] = self._draw(people, outlines, k, window, (pixels, depth, owner))
        return View(self._expose(pixels, noise), *_truth(moment.bodies, outlines, windows, owner, covered))

    def _with(self, leaves: Surfaces) -> Layer:
        key = leaves.segments_m.tobytes() + leaves.z_m.tobytes() + leaves.colour.tobytes()
        if key != self._leaves[0]:
            self._leaves = (key, with_leaves(self._sight, self._rooms, leaves))
        return self._leaves[1]

    def _shadow_px(self, body: Body) -> Floats | None:
        """Outline of a shadow around the feet; None where it is not before the camera."""
        turn = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.zeros((16, 3))
        ring[:, :2] = body.position_m + 0.6 * body.width_m * np.column_stack([np.cos(turn), np.sin(turn)])
        ring = self._sight.to_camera(ring)
        return self._sight.lens.project(ring) if (ring[:, 2] > NEAREST_M).all() else None

    def _draw(
        self,
        people: Figures,
        outlines: _Outlines,
        k: int,
        window: tuple[slice, slice],
        canvas: tuple[Pixels, NDArray[np.float32], NDArray[np.int16]],
    ) -> int:
        """Draw one person where nothing is nearer; gives how many pixels of the image it would cover."""
        pixels, depth, owner = (layer[window] for layer in canvas)
        figure = np.zeros(pixels.shape, np.uint8)
        near = np.full(depth.shape, np.inf, np.float32)
        corner = (window[1].start, window[0].start)
        spheres = np.round((outlines.spheres_px[k] - corner) * 2**_SHIFT).astype(np.int32)
        part_depth = outlines.depth_m[k]
        bright = self._brightness(window, float(part_depth.mean()))
        for p in np.argsort(-part_depth, kind="stable"):
            if not outlines.is_drawn[k, p]:
                continue
            part = PARTS[p]
            colour = bright * people.colour[k, part.colour]
            whole, lit = (cv2.convexHull(spheres[list(part.spheres), area].reshape(-1, 2)) for area in (0, 1))
            cv2.fillConvexPoly(figure, whole, (0.7 * colour).tolist(), cv2.LINE_8, _SHIFT)
            cv2.fillConvexPoly(near, whole, float(part_depth[p]), cv2.LINE_8, _SHIFT)
            cv2.fillConvexPoly(figure, lit, colour.tolist(), cv2.LINE_8, _SHIFT)
        start = 7 * k % _SPARE_PX
        cloth = self._cloth[start : start + pixels.shape[0], start : start + pixels.shape[1]]
        cv2.add(figure, cloth, figure, dtype=cv2.CV_8U)
        is_seen = near < depth
        np.copyto(depth, near, where=is_seen)
        np.copyto(owner, np.int16(k), where=is_seen)
        cv2.copyTo(figure, is_seen.view(np.uint8), pixels)
        return int(np.count_nonzero(near < np.inf))

    def _brightness(self, window: tuple[slice, slice], depth_m: float) -> float:
        middle = tuple((side.start + side.stop) // 2 for side in window)
        return float(np.clip(1.05 - 0.03 * depth_m, 0.55, 1.0) * self._sight.vignette[middle])

    def _expose(self, pixels: Pixels, noise: np.random.Generator) -> Pixels:
        blurred = cv2.GaussianBlur(pixels, (3, 3), 0.55)
        bright = cv2.convertScaleAbs(blurred, alpha=1 + 0.02 * float(noise.standard_normal()))
        down, right = noise.integers(0, _SPARE_PX, 2)
        rows, columns = pixels.shape[:2]
        grain = self._grain[down : down + rows, right : right + columns]
        return np.asarray(cv2.add(bright, grain, dtype=cv2.CV_8U), np.uint8)


def _outlines(people: Figures, view: Sight) -> _Outlines:
    centre = view.to_camera(people.centre_m)
    depth, radius = centre[..., 2], people.radius_m
    is_before = depth - radius > NEAREST_M
    way = np.where(is_before[..., None], centre, np.array([0.0, 0.0, 1.0]))
    way = way / np.linalg.norm(way, axis=-1, keepdims=True)
    right = np.stack([way[..., 2], np.zeros_like(depth), -way[..., 0]], axis=-1)
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    down = np.cross(way, right)
    turn = np.linspace(0, 2 * np.pi, _CORNERS, endpoint=False)
    # a little outside, so that the polygon covers as much as the circle
    outside = np.sqrt(np.pi / (_CORNERS / 2 * np.sin(2 * np.pi / _CORNERS)))
    ring = outside * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    rings = np.stack([ring, _LIT * ring - 0.22])
    offsets = np.einsum("akc,cbsx->bsakx", rings, np.stack([right, down]))
    points = centre[:, :, None, None] + radius[..., None, None, None] * offsets
    points = np.where(is_before[..., None, None, None], points, np.array([0.0, 0.0, 1.0]))
    pixels = view.lens.project(points.reshape(-1, 3)).reshape(*points.shape[:-1], 2)
    is_drawn = np.stack([is_before[:, list(part.spheres)].all(axis=1) for part in PARTS], axis=1)
    is_used = np.einsum("bp,ps->bs", is_drawn, _MEMBERS)[..., None, None]
    low = np.where(is_used, pixels[:, :, 0], np.inf).min(axis=(1, 2))
    high = np.where(is_used, pixels[:, :, 0], -np.inf).max(axis=(1, 2))
    part_depth = depth @ (_MEMBERS / _MEMBERS.sum(axis=1, keepdims=True)).T
    return _Outlines(pixels, part_depth, is_drawn, np.concatenate([low, high], axis=1))


def _window(box_px: Floats, shape: tuple[int, ...]) -> tuple[slice, slice] | None:
    """Rows and columns of the image that a figure may cover; None: it is not in it."""
    left, top, right, bottom = box_px
    height, width = shape
    if not (left < width - 0.5 and right > -0.5 and top < height - 0.5 and bottom > -0.5):
        return None
    rows = slice(max(0, int(np.floor(top)) - 1), min(height, int(np.ceil(bottom)) + 2))
    return rows, slice(max(0, int(np.floor(left)) - 1), min(width, int(np.ceil(right)) + 2))


def _shade_floor(pixels: Pixels, depth: NDArray[np.float32], outline_px: Floats | None) -> None:
    if outline_px is None:
        return
    low, high = outline_px.min(axis=0), outline_px.max(axis=0)
    window = _window(np.concatenate([low, high]), depth.shape)
    if window is None:
        return
    area = np.zeros(depth[window].shape, np.uint8)
    polygon = np.round((outline_px - (window[1].start, window[0].start)) * 2**_SHIFT).astype(np.int32)
    cv2.fillConvexPoly(area, polygon, 1, cv2.LINE_8, _SHIFT)
    is_floor = (area > 0) & np.isinf(depth[window])
    pixels[window][is_floor] = (0.75 * pixels[window][is_floor]).astype(np.uint8)


def _truth(
    bodies: Sequence[Body],
    outlines: _Outlines,
    windows: Sequence[tuple[slice, slice] | None],
    owner: NDArray[np.int16],
    covered: Floats,
) -> tuple[tuple[str, ...], Floats, Floats]:
    height, width = owner.shape
    inside = [k for k, window in enumerate(windows) if window is not None]
    corners = np.clip(outlines.box_px[inside], -0.5, np.array([width, height, width, height]) - 0.5)
    seen = np.array([np.count_nonzero(owner[windows[k]] == k) for k in inside], np.float64)
    return tuple(bodies[k].name for k in inside), corners, seen / np.maximum(covered[inside], 1)
