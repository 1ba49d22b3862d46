"""How a camera sees and where it hangs, from points of the floor and where they are in its image.

The homography from the floor to the image is K [r1 r2 t] up to a factor. With square pixels and the principal
point in the middle of the image only the focal length f of K is unknown; r1 and r2 are at right angles and of
one length, which gives f twice (Zhang 2000, section 3.1): taken by least squares. From there pose and f go to
where the pixels are missed least.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from semap.errors import InvalidInput

LEAST_SHARE = 1e-3
"""Of what the two equations hold: with less they tell no focal length."""
MOST_OFF_PX = 20.0
WHERE = "homography"
LEAST_ASIDE = 0.03
"""How far from a line points have to be, of how far they are from one another."""
LEAST_DEPTH_M = 1e-3


@dataclass(frozen=True, eq=False)
class SeenFloor:
    """map_T_camera (4, 4) of the optical frame; off_px: by so much the points miss their pixels, at worst."""

    focal_px: float
    map_T_camera: NDArray[np.float64]
    off_px: float


def camera_over(
    floor_m: NDArray[np.float64],
    pixels: NDArray[np.float64],
    size_px: tuple[int, int],
    floor_z_m: float = 0.0,
    focal_px: float | None = None,
) -> SeenFloor:
    """The camera that sees points of the floor so.

    floor_m   (n, 2) [m, map], n at least 4
    pixels    (n, 2), the same in its image
    focal_px  of the lens, where it is known
    raises    InvalidInput where points lie on a line, tell no focal length, or are not of one camera
    """
    middle = np.array(size_px) / 2
    centre_m = floor_m.mean(axis=0)
    on_line = _is_on_line(floor_m) or _is_on_line(pixels)
    found = None if on_line else cv2.findHomography(floor_m - centre_m, pixels - middle)[0]
    if found is None or abs(np.linalg.det(found / np.linalg.norm(found))) < 1e-12:
        raise InvalidInput(
            "its points lie on one line, or all but one do",
            "Give four corners of an area of the floor, as far from one another as the image shows.",
            WHERE,
        )
    tied: NDArray[np.float64] = np.asarray(found, dtype=np.float64)
    focal = _focal_px(tied) if focal_px is None else focal_px
    ways = tied / [[focal], [focal], [1.0]]
    ways /= np.sqrt(np.linalg.norm(ways[:, 0]) * np.linalg.norm(ways[:, 1]))
    ways *= np.sign(ways[2, 2]) or 1.0  # the floor is before the camera
    turn, _, other = np.linalg.svd(
        np.column_stack([ways[:, 0], ways[:, 1], np.cross(ways[:, 0], ways[:, 1])])
    )
    camera_R_map = turn @ np.diag([1, 1, np.linalg.det(turn @ other)]) @ other
    known_px = None if focal_px is None else focal
    seen = _refined(camera_R_map, ways[:, 2], focal, floor_m - centre_m, pixels - middle, known_px)
    map_T_camera = seen.map_T_camera
    map_T_camera[:3, 3] += [*centre_m, floor_z_m]
    if seen.off_px <= MOST_OFF_PX and map_T_camera[2, 3] <= floor_z_m:
        raise InvalidInput(
            "its points are a mirror image: so they are seen from below the floor",
            "See that points and pixels are in the same order, and that y of pixels goes down.",
            WHERE,
        )
    if seen.off_px > MOST_OFF_PX:
        raise InvalidInput(
            f"no camera above the floor sees its points so: the best is {seen.off_px:.0f} px off",
            "See that points and pixels are in the same order, pixels counted from the upper left corner, and"
            " the image not cropped or distorted; or give focal_px.",
            WHERE,
        )
    return seen


def _is_on_line(points: NDArray[np.float64]) -> bool:
    """Whether all points (n, 2) lie on one line, or all but one: then nothing tells what is beside it."""
    extent = np.ptp(points, axis=0).max()
    for one, other in combinations(points, 2):
        along = other - one
        length = np.hypot(*along)
        if length > LEAST_ASIDE * extent:
            aside = np.abs((points - one) @ [-along[1], along[0]]) / length
            if np.count_nonzero(aside > LEAST_ASIDE * extent) < 2:
                return True
    return bool(extent == 0)


def _focal_px(homography: NDArray[np.float64]) -> float:
    """From h1 W h2 = 0 and h1 W h1 = h2 W h2 with W = diag(1 / f^2, 1 / f^2, 1): a / f^2 + b = 0 each."""
    one, two = homography[:, 0], homography[:, 1]
    a = np.array([one[:2] @ two[:2], one[:2] @ one[:2] - two[:2] @ two[:2]])
    b = np.array([one[2] * two[2], one[2] ** 2 - two[2] ** 2])
    square = -(a @ a) / (a @ b) if (a @ b) else -1.0
    whole = one[:2] @ one[:2] + two[:2] @ two[:2]
    if not square > 0 or np.abs(a).max() < LEAST_SHARE * whole:
        raise InvalidInput(
            "its points do not tell the focal length: the camera looks straight down, or they are not exact",
            "Give focal_px: half the width of the image, divided by the tangent of half its angle of view.",
            WHERE,
        )
    return float(np.sqrt(square))


def _refined(
    camera_R_map: NDArray[np.float64],
    origin_m: NDArray[np.float64],
    focal_px: float,
    floor_m: NDArray[np.float64],
    pixels: NDArray[np.float64],
    known_px: float | None,
) -> SeenFloor:
    """The camera whose pixels miss those told least, from one that is near; a known focal length stays.

    origin_m  (3,) of the points' frame in the camera's
    """

    def missed(moved: NDArray[np.float64]) -> NDArray[np.float64]:
        turn = Rotation.from_rotvec(moved[:3]).as_matrix() @ camera_R_map
        in_camera = floor_m @ turn[:, :2].T + origin_m + moved[3:6]
        depth = np.maximum(in_camera[:, 2:], LEAST_DEPTH_M)
        return np.asarray(
            focal_px * np.exp(moved[6:].sum()) * in_camera[:, :2] / depth - pixels, np.float64
        ).ravel()

    found = least_squares(missed, np.zeros(7 if known_px is None else 6), x_scale="jac")
    turn = Rotation.from_rotvec(found.x[:3]).as_matrix() @ camera_R_map
    map_T_camera = np.eye(4)
    map_T_camera[:3, :3], map_T_camera[:3, 3] = turn.T, -turn.T @ (origin_m + found.x[3:6])
    focal_px *= float(np.exp(found.x[6:].sum()))
    return SeenFloor(focal_px, map_T_camera, float(np.hypot(*found.fun.reshape(-1, 2).T).max()))
