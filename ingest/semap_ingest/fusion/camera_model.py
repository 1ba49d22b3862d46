"""Points of the optical frame to pixels of the image as it came, and pixels back to rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.fusion.distortion import distort, lens_of, undistort
from semap_ingest.sensing.image import Camera

LEAST_DEPTH_M = 1e-6
"""Before the camera: anything nearer has no pixel that could be computed."""


def project(points_m: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Project points onto the image plane: pinhole and distortion.

    points_m  (n, 3) [m, optical frame of the camera]
    returns   (n, 2) [px, origin in the centre of the top left pixel], also outside of the image; NaN where
              z is not above a micrometre and where the distortion is not defined
    raises    InvalidInput for a camera that cannot be (see `distortion.lens_of`)
    """
    return project_with_derivative(points_m, camera)[0]


def project_with_derivative(
    points_m: NDArray[np.float64], camera: Camera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """As `project`, and (n, 2, 3) the derivatives of the pixels by the points [px/m]."""
    points = np.asarray(points_m, dtype=np.float64).reshape(-1, 3)
    depth = np.where(points[:, 2] > LEAST_DEPTH_M, points[:, 2], np.nan)
    rays = points[:, :2] / depth[:, None]
    bent, by_ray = distort(lens_of(camera), rays)
    matrix = _matrix(camera)
    pixels = bent @ matrix[:, :2].T + matrix[:, 2]
    ray_by_point = np.zeros((len(points), 2, 3))
    ray_by_point[:, 0, 0] = ray_by_point[:, 1, 1] = 1 / depth
    ray_by_point[:, :, 2] = -rays / depth[:, None]
    return pixels, matrix[:, :2] @ by_ray @ ray_by_point


def unproject(pixels: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """The rays along which pixels see.

    pixels   (n, 2) [px]
    returns  (n, 3) of length 1 [optical frame]; NaN where no ray falls on the pixel
    raises   InvalidInput for a camera that cannot be
    """
    at = np.asarray(pixels, dtype=np.float64).reshape(-1, 2)
    matrix = _matrix(camera)
    bent = np.asarray(np.linalg.solve(matrix[:, :2], (at - matrix[:, 2]).T).T, dtype=np.float64)
    rays = undistort(lens_of(camera), bent)
    lengths = np.sqrt(1 + (rays * rays).sum(axis=1))
    return np.asarray(np.column_stack([rays, np.ones(len(rays))]) / lengths[:, None])


def _matrix(camera: Camera) -> NDArray[np.float64]:
    """(2, 3), the upper rows of K."""
    matrix = np.asarray(camera.matrix, dtype=np.float64)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or matrix[0, 0] * matrix[1, 1] == 0:
        raise InvalidInput(
            f"The camera matrix K of {camera.frame} has no focal lengths: {matrix.tolist()}.",
            "Calibrate the camera, or give a CameraInfo with K.",
            "camera",
        )
    return matrix[:2]
