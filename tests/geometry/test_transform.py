import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from semap.errors import InvalidInput
from semap.geometry.pose import pose_from_matrix, pose_from_yaw, transform_points

POINTS_M = np.array([[0.0, 0, 0], [1, 2, 3], [-4, 5, 0.5]])
SHIFT_M = np.array([10.0, -3.0, 0.25])

rotations = st.integers(0, 2**32 - 1).map(lambda seed: Rotation.random(rng=np.random.default_rng(seed)))


def matrix_of(rotation: Rotation) -> NDArray[np.float64]:
    parent_T_child = np.eye(4)
    parent_T_child[:3, :3] = rotation.as_matrix()
    parent_T_child[:3, 3] = SHIFT_M
    return parent_T_child


@given(rotations)
def test_points_are_turned_then_moved(rotation: Rotation) -> None:
    assert np.allclose(transform_points(matrix_of(rotation), POINTS_M), rotation.apply(POINTS_M) + SHIFT_M)


@given(rotations)
def test_a_matrix_and_its_pose_say_the_same(rotation: Rotation) -> None:
    pose = pose_from_matrix(matrix_of(rotation))
    assert np.allclose(pose.matrix(), matrix_of(rotation), atol=1e-12)
    assert pose.qw >= 0


@given(st.floats(-3.1, 3.1))
def test_a_yaw_turns_the_x_axis_towards_y(yaw_rad: float) -> None:
    ahead = transform_points(pose_from_yaw(1, 2, 3, yaw_rad).matrix(), [[1, 0, 0]])[0]
    assert np.allclose(ahead, [1 + np.cos(yaw_rad), 2 + np.sin(yaw_rad), 3])


@pytest.mark.parametrize(
    "diagonal",
    [(1, 1, -1), (2, 2, 2), (1, 1, 1.001), (np.nan, 1, 1)],
    ids=["mirror", "scale", "stretch", "nan"],
)
def test_what_is_no_pose_is_refused(diagonal: tuple[float, float, float]) -> None:
    with pytest.raises(InvalidInput, match="rotation and a translation"):
        pose_from_matrix(np.diag([*diagonal, 1.0]))
