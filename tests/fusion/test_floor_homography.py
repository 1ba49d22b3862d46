"""Four points of the floor and their pixels give back the camera that saw them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from semap_ingest.fusion.floor_homography import camera_over

from semap.errors import InvalidInput

SIZE = (1280, 720)


def hung(height_m: float, yaw: float, down: float, roll: float = 0.0) -> NDArray[np.float64]:
    """map_T_camera: optical frame, turned by yaw, looking down by an angle."""
    optical = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("ZYX", [yaw, down, roll]).as_matrix() @ optical
    pose[:3, 3] = 7.0, -3.0, height_m
    return pose


def seen(
    pose: NDArray[np.float64], focal_px: float, floor_m: NDArray[np.float64], z_m: float
) -> NDArray[np.float64]:
    points = (np.column_stack([floor_m, np.full(len(floor_m), z_m)]) - pose[:3, 3]) @ pose[:3, :3]
    return focal_px * points[:, :2] / points[:, 2:] + np.array(SIZE) / 2


def corners(pose: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Of an area before it, along the way it looks and aslant to it."""
    local = np.array([[2.5, -1.0], [2.7, 1.3], [6.0, 2.0], [5.5, -2.1]])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    return local @ turn.T + pose[:2, 3]


@given(st.floats(2.0, 4.0), st.floats(-3.1, 3.1), st.floats(0.3, 0.9), st.floats(-0.1, 0.1), st.floats(500, 1500),
       st.sampled_from([0.0, 3.2]))  # fmt: skip
def test_the_camera_comes_back(
    height_m: float, yaw: float, down: float, roll: float, focal_px: float, z_m: float
) -> None:
    pose = hung(height_m + z_m, yaw, down, roll)
    floor_m = corners(pose, yaw)
    found = camera_over(floor_m, seen(pose, focal_px, floor_m, z_m), SIZE, z_m)
    assert found.focal_px == pytest.approx(focal_px, rel=1e-4)
    np.testing.assert_allclose(found.map_T_camera, pose, atol=1e-3)
    assert found.off_px < 0.1


@given(st.integers(0, 2**32 - 1))
def test_clicks_that_are_a_pixel_off_move_the_camera_little(seed: int) -> None:
    pose = hung(2.6, 0.7, 0.5)
    floor_m = corners(pose, 0.7)
    pixels = seen(pose, 900.0, floor_m, 0.0) + np.random.default_rng(seed).uniform(-1, 1, (4, 2))
    found = camera_over(floor_m, pixels, SIZE)
    assert found.off_px < 20
    assert np.linalg.norm(found.map_T_camera[:3, 3] - pose[:3, 3]) < 0.5
    known = camera_over(floor_m, pixels, SIZE, focal_px=900.0)
    assert np.linalg.norm(known.map_T_camera[:3, 3] - pose[:3, 3]) < 0.2


@given(st.integers(0, 2**32 - 1))
def test_no_camera_near_misses_the_pixels_less(seed: int) -> None:
    random = np.random.default_rng(seed)
    pose = hung(2.6, 0.7, 0.5)
    floor_m = np.vstack(
        [corners(pose, 0.7), random.uniform(corners(pose, 0.7).min(0), corners(pose, 0.7).max(0), (3, 2))]
    )
    pixels = seen(pose, 900.0, floor_m, 0.0) + random.normal(0, 1.5, (7, 2))
    found = camera_over(floor_m, pixels, SIZE)

    def missed(camera: NDArray[np.float64], focal_px: float) -> float:
        return float(np.sum((seen(camera, focal_px, floor_m, 0.0) - pixels) ** 2))

    least = missed(found.map_T_camera, found.focal_px)
    assert least <= missed(pose, 900.0)
    for _ in range(20):
        near = found.map_T_camera.copy()
        near[:3, :3] = near[:3, :3] @ Rotation.from_rotvec(random.normal(0, 1e-3, 3)).as_matrix()
        near[:3, 3] += random.normal(0, 3e-3, 3)
        assert least <= missed(near, found.focal_px * np.exp(random.normal(0, 1e-3))) + 1e-6


def test_points_that_tell_no_camera_are_refused() -> None:
    pose = hung(2.6, 0.0, 0.5)
    floor_m = corners(pose, 0.0)
    pixels = seen(pose, 900.0, floor_m, 0.0)
    line = np.array([[1.0, 0], [2, 0], [3, 0], [4, 0]])
    with pytest.raises(InvalidInput, match="lie on one line"):
        camera_over(line, seen(pose, 900.0, line + np.array([9, -3]), 0.0), SIZE)
    for but_one in (
        [[10.0, -3], [11, -3], [12, -3], [11, -1.5]],
        [[10.0, -3], [12, -3], [12.0, -3], [11, -1.5]],
    ):
        points = np.array(but_one)
        with pytest.raises(InvalidInput, match="lie on one line"):
            camera_over(points, seen(pose, 900.0, points, 0.0), SIZE, focal_px=900.0)
    with pytest.raises(InvalidInput, match=r"no camera above the floor|do not tell the focal length"):
        camera_over(floor_m, pixels[[0, 2, 1, 3]], SIZE)
    for mirrored, upright in (
        (floor_m * [1, -1], pixels),
        (floor_m, np.array([SIZE[0], 0]) - pixels * [1, -1]),
    ):
        with pytest.raises(InvalidInput, match="mirror image"):
            camera_over(mirrored, upright, SIZE)
    above = hung(4.0, 0.0, np.pi / 2)
    floor_m = np.array([[6.0, -4], [8, -4], [8, -2], [6, -2]])
    with pytest.raises(InvalidInput, match="do not tell the focal length") as caught:
        camera_over(floor_m, seen(above, 900.0, floor_m, 0.0), SIZE)
    assert "focal_px" in caught.value.remedy
    found = camera_over(floor_m, seen(above, 900.0, floor_m, 0.0), SIZE, focal_px=900.0)
    np.testing.assert_allclose(found.map_T_camera[:3, 3], above[:3, 3], atol=1e-3)
