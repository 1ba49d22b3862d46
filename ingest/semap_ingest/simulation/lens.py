"""Where the pixels of a camera look and where points fall in its image."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.sensing.image import Camera

Floats = NDArray[np.float64]

WIDEST = 6.0
"""Radius on the plane z = 1 (80.5 degrees off the axis) beyond which nothing is projected any more."""


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera with its distortion undone once for all pixels.

    rays     (height, width, 2) float32: x and y at z = 1 [optical frame] of what a pixel's middle sees
    columns  (width, 2) least and greatest x of the rays in each column
    rows     (height, 2) least and greatest y of the rays in each row
    reach    radius on the plane z = 1 up to which a larger angle falls farther from the middle of the image
    """

    camera: Camera
    rays: NDArray[np.float32]
    columns: NDArray[np.float32]
    rows: NDArray[np.float32]
    reach: float

    def project(self, points_m: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 3) [m, optical frame] with z > 0; pixel middles are whole numbers.

        Points beyond the reach of the lens come out at its rim, in their direction.
        """
        plane = points_m[:, :2] / points_m[:, 2:]
        radius = np.hypot(plane[:, 0], plane[:, 1])
        plane *= (self.reach / np.maximum(radius, self.reach))[:, None]
        return _distort(plane, self.camera.matrix, self.camera.distortion)


@lru_cache(maxsize=8)
def lens_of(camera: Camera) -> Lens:
    """Raises InvalidInput for a fisheye camera, and for a distortion that leaves its corners empty."""
    if camera.model == "equidistant":
        raise InvalidInput(
            "The simulated camera has no fisheye lens.",
            "Use the distortion model plumb_bob or rational_polynomial.",
            "camera.model",
        )
    across, down = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    pixels = np.column_stack([across.ravel(), down.ravel()]).astype(np.float64)
    focal = np.array([camera.matrix[0, 0], camera.matrix[1, 1]])
    aim = (pixels - camera.matrix[:2, 2]) / focal
    aim[:, 0] -= camera.matrix[0, 1] / camera.matrix[0, 0] * aim[:, 1]
    reach = _reach(camera)
    rim = _distort(np.array([[reach, 0.0]]), np.eye(3), camera.distortion)[0, 0]
    if np.hypot(aim[:, 0], aim[:, 1]).max() >= rim:
        raise InvalidInput(
            "The distortion bends the image so much that nothing falls into its corners.",
            "Use a weaker distortion or a longer focal length.",
            "camera.distortion",
        )
    of_pixel = _undistort(aim, camera).reshape(camera.height_px, camera.width_px, 2).astype(np.float32)
    x, y = of_pixel[..., 0], of_pixel[..., 1]
    return Lens(
        camera,
        of_pixel,
        np.column_stack([x.min(axis=0), x.max(axis=0)]),
        np.column_stack([y.min(axis=1), y.max(axis=1)]),
        reach,
    )


def _undistort(aim: Floats, camera: Camera) -> Floats:
    """What `_distort` takes to `aim` (n, 2): steps by the error that is left, where any is."""
    coefficients = _coefficients(camera.distortion)
    plane = np.asarray(cv2.undistortPoints(aim, np.eye(3), coefficients), np.float64).reshape(-1, 2)
    left = np.arange(len(plane))
    for _ in range(200):
        error = aim[left] - _distort(plane[left], np.eye(3), camera.distortion)
        is_off = np.abs(error).max(axis=1) > 1e-7
        left = left[is_off]
        if len(left) == 0:
            break
        plane[left] += error[is_off]
    return plane


def _reach(camera: Camera) -> float:
    radius = np.linspace(0.0, WIDEST, 601)
    seen = _distort(np.column_stack([radius, np.zeros_like(radius)]), np.eye(3), camera.distortion)[:, 0]
    folds = np.flatnonzero(np.diff(seen) <= 0)
    return float(radius[folds[0]]) if len(folds) else WIDEST


def _distort(plane: Floats, matrix: Floats, distortion: Floats) -> Floats:
    if len(plane) == 0:
        return np.zeros((0, 2))
    points = np.column_stack([plane, np.ones(len(plane))])
    still = np.zeros(3)
    matrix = np.asarray(matrix, np.float64)
    pixels, _ = cv2.projectPoints(points, still, still, matrix, _coefficients(distortion))
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def _coefficients(distortion: Floats) -> Floats:
    return np.asarray(distortion, np.float64) if len(distortion) else np.zeros(5)
