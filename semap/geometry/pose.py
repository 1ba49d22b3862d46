"""Poses as matrices: applying them to points, and reading them back from a placement."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from semap.errors import InvalidInput
from semap.model.building import Mesh
from semap.model.pose import Pose

RIGID_TOLERANCE = 1e-6
"""How far R^T R may be from the identity, entry by entry; placements are often written as float32."""


def transform_points(parent_T_child: ArrayLike, points_m: ArrayLike) -> NDArray[np.float64]:
    """Map points from the child frame to its parent.

    parent_T_child  (4, 4), homogeneous, last row 0 0 0 1
    points_m        (n, 3) [m, child frame]
    returns         (n, 3) float64 [m, parent frame]
    """
    matrix = np.asarray(parent_T_child, dtype=np.float64)
    points = np.asarray(points_m, dtype=np.float64)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def transform_mesh(parent_T_child: ArrayLike, mesh: Mesh) -> Mesh:
    """The same mesh in the parent frame."""
    return Mesh(transform_points(parent_T_child, mesh.vertices_m), mesh.faces)


def pose_from_matrix(parent_T_child: ArrayLike) -> Pose:
    """The pose that a homogeneous matrix describes, with qw >= 0.

    parent_T_child  (4, 4)
    raises          InvalidInput if it scales, shears, mirrors or is not finite
    """
    matrix = np.asarray(parent_T_child, dtype=np.float64)
    rotation = matrix[:3, :3]
    is_rigid = (
        bool(np.isfinite(matrix).all())
        and np.allclose(rotation.T @ rotation, np.eye(3), atol=RIGID_TOLERANCE)
        and np.linalg.det(rotation) > 0
    )
    if not is_rigid:
        raise InvalidInput(
            "a placement that is not a rotation and a translation",
            "Export the model without scaled or mirrored placements.",
        )
    from scipy.spatial.transform import Rotation  # noqa: PLC0415  slow to import

    x, y, z, w = (float(part) for part in Rotation.from_matrix(rotation).as_quat(canonical=True))
    return Pose(float(matrix[0, 3]), float(matrix[1, 3]), float(matrix[2, 3]), x, y, z, w)


def pose_from_yaw(x_m: float, y_m: float, z_m: float, yaw_rad: float) -> Pose:
    """The pose at a point whose x axis is turned by a yaw about z, counter-clockwise."""
    return Pose(x_m, y_m, z_m, qz=float(np.sin(yaw_rad / 2)), qw=float(np.cos(yaw_rad / 2)))
