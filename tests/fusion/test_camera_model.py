from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.fusion.camera_model import project, project_with_derivative, unproject
from semap_ingest.sensing.image import Camera

from semap.errors import InvalidInput

K = np.array([[320.0, 0.0, 321.5], [0.0, 318.0, 238.5], [0.0, 0.0, 1.0]])
CAMERAS = [
    Camera("c", 640, 480, K, np.zeros(0)),
    Camera("c", 640, 480, K, np.array([-0.28, 0.07, 0.0008, -0.0005, 0.0])),
    Camera("c", 640, 480, K, np.array([-0.28, 0.07, 0.0008, -0.0005])),
    Camera("c", 640, 480, K, np.array([0.12, -0.2, 0.001, 0.002, 0.08])),
    Camera("c", 640, 480, K, np.array([2.1, 0.9, 1e-4, -2e-4, 0.03, 2.4, 1.5, 0.2]), "rational_polynomial"),
    Camera("c", 640, 480, K, np.array([0.08, -0.02, 0.004, -0.001]), "equidistant"),
    Camera("c", 640, 480, K, np.zeros(4), "equidistant"),
    Camera("c", 640, 480, K @ [[1, 0.01, 0], [0, 1, 0], [0, 0, 1]], np.array([-0.1, 0.0, 0, 0, 0])),
]


def points_in_view(seed: int, count: int = 200, widest: float = 0.9) -> np.ndarray:
    generator = np.random.default_rng(seed)
    depth = generator.uniform(0.2, 30, count)
    return np.column_stack([generator.uniform(-widest, widest, (count, 2)) * depth[:, None], depth])


def opencv_project(points: np.ndarray, camera: Camera) -> np.ndarray:
    zero = np.zeros(3)
    if camera.model == "equidistant":
        return cv2.fisheye.projectPoints(points[:, None], zero, zero, K, camera.distortion)[0][:, 0]
    skewless = camera.matrix.copy()
    skewless[0, 1] = 0
    distortion = camera.distortion if len(camera.distortion) else None
    pixels = cv2.projectPoints(points, zero, zero, skewless, distortion)[0][:, 0]
    pixels[:, 0] += camera.matrix[0, 1] * (pixels[:, 1] - K[1, 2]) / K[1, 1]
    return pixels


@pytest.mark.parametrize("camera", CAMERAS)
def test_pixels_are_those_of_opencv(camera: Camera) -> None:
    points = points_in_view(1)
    assert np.allclose(project(points, camera), opencv_project(points, camera), atol=1e-8)


@pytest.mark.parametrize("camera", CAMERAS)
def test_the_derivative_is_that_of_opencv_or_of_differences(camera: Camera) -> None:
    points = points_in_view(2)
    _, derivative = project_with_derivative(points, camera)
    differences = np.stack(
        [(project(points + d, camera) - project(points - d, camera)) / 2e-6 for d in 1e-6 * np.eye(3)], axis=2
    )
    assert np.allclose(derivative, differences, atol=1e-3, rtol=1e-5)
    if camera.model != "equidistant" and not camera.matrix[0, 1]:
        by_all = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[1]
        assert np.allclose(derivative, by_all[:, 3:6].reshape(-1, 2, 3), atol=1e-7)


@pytest.mark.parametrize("camera", CAMERAS)
def test_rays_of_pixels_go_through_their_points(camera: Camera) -> None:
    points = points_in_view(3)
    rays = unproject(project(points, camera), camera)
    assert np.allclose(np.linalg.norm(rays, axis=1), 1)
    assert np.allclose(rays, points / np.linalg.norm(points, axis=1)[:, None], atol=1e-8)


@given(
    st.floats(-0.4, 0.4),
    st.floats(-0.2, 0.2),
    st.floats(-0.003, 0.003),
    st.floats(-0.003, 0.003),
    st.floats(-0.1, 0.1),
    st.sampled_from(["plumb_bob", "equidistant"]),
)
def test_what_is_projected_comes_back_for_any_lens(
    k1: float, k2: float, p1: float, p2: float, k3: float, model: str
) -> None:
    parameters = [k1, k2, p1, p2, k3] if model == "plumb_bob" else [k1, k2 / 4, p1, p2]
    camera = Camera("c", 640, 480, K, np.array(parameters), model)  # type: ignore[arg-type]
    points = points_in_view(4, widest=3)
    pixels, derivative = project_with_derivative(points, camera)
    rays = unproject(pixels, camera)
    found = np.isfinite(rays[:, 0])
    assert np.isfinite(pixels[found]).all()
    assert np.allclose(project(rays[found], camera), pixels[found], atol=1e-6)
    # Close to the limit of the lens a tiny step of the pixel is a large one of the ray.
    seen = np.flatnonzero(np.isfinite(pixels[:, 0]))
    seen = seen[np.linalg.cond(derivative[seen, :, :2]) < 50]
    expected = points[seen] / np.linalg.norm(points[seen], axis=1)[:, None]
    is_same = np.isclose(rays[seen], expected, atol=1e-6).all(axis=1)
    # Where a lens is nearly flat, its tangential part may fold the image: then the ray is one nearer to the axis.
    assert (is_same | (rays[seen, 2] > expected[:, 2])).all()
    assert is_same.all() or (p1 or p2)


def test_points_behind_the_camera_have_no_pixel() -> None:
    for camera in CAMERAS:
        assert np.isnan(project(np.array([[0.1, 0.1, -1.0], [0, 0, 0], [np.nan, 0, 1]]), camera)).all()


def test_a_picture_does_not_fold_back() -> None:
    """Barrel distortion k1 = -0.28: the radius grows up to sqrt(1 / (3 * 0.28)) and would then shrink again."""
    camera = Camera("c", 640, 480, K, np.array([-0.28, 0, 0, 0, 0]))
    limit = np.sqrt(1 / (3 * 0.28))
    radius = np.linspace(0, 3, 301)
    u = project(np.column_stack([radius, 0 * radius, 1 + 0 * radius]), camera)[:, 0]
    assert np.array_equal(np.isfinite(u), radius < limit)
    assert (np.diff(u[radius < limit]) > 0).all()
    farthest = K[0, 2] + K[0, 0] * limit * (1 - 0.28 * limit**2)
    rays = unproject(np.array([[farthest - 0.01, K[1, 2]], [farthest + 0.01, K[1, 2]]]), camera)
    assert np.isfinite(rays[0]).all()
    assert np.isnan(rays[1]).all()


def test_a_pole_of_the_rational_model_is_a_limit() -> None:
    camera = Camera("c", 640, 480, K, np.array([0, 0, 0, 0, 0, -1.0, 0, 0]), "rational_polynomial")
    u = project(np.array([[0.99, 0, 1], [1.01, 0, 1], [5, 0, 1]]), camera)[:, 0]
    assert np.array_equal(np.isfinite(u), [True, False, False])


def test_a_fisheye_sees_almost_sideways() -> None:
    camera = Camera("c", 640, 480, K, np.zeros(4), "equidistant")
    angle = np.radians([0, 1e-3, 45, 80, 89])
    rays = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    pixels = project(rays, camera)
    assert np.allclose(pixels[:, 0], K[0, 2] + K[0, 0] * angle)
    assert np.allclose(unproject(pixels, camera), rays, atol=1e-9)
    assert np.isnan(unproject(np.array([[K[0, 2] + K[0, 0] * 1.58, K[1, 2]]]), camera)).all()


def test_nothing_in_nothing_out() -> None:
    for camera in CAMERAS:
        assert project(np.empty((0, 3)), camera).shape == (0, 2)
        assert unproject(np.empty((0, 2)), camera).shape == (0, 3)


@pytest.mark.parametrize(
    ("matrix", "distortion", "model"),
    [
        (np.zeros((3, 3)), [0.0], "plumb_bob"),
        (K, [np.nan], "plumb_bob"),
        (K, [0, 0, 0, 0, 0, 0.1], "plumb_bob"),
        (K, [0, 0, 0, 0, 0.1], "equidistant"),
        (K, [], "fisheye624"),
    ],
)
def test_a_camera_that_cannot_be_is_refused(matrix: np.ndarray, distortion: list[float], model: str) -> None:
    with pytest.raises(InvalidInput) as refused:
        project(np.ones((1, 3)), Camera("c", 640, 480, matrix, np.array(distortion), model))  # type: ignore[arg-type]
    assert refused.value.remedy
