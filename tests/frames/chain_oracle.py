"""Where a frame is in another, by scipy: the whole chain from the root, one rotation after the other."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp
from semap_ingest.sensing.transform import Transform


def pose_at(transforms: list[Transform], stamp_us: int) -> NDArray[np.float64]:
    """(4, 4) parent_T_child of one edge; its transforms in the order of their stamps, around the stamp."""
    if transforms[0].is_static:
        return homogeneous(transforms[-1].translation_m, Rotation.from_quat(transforms[-1].quaternion))
    stamps = np.array([each.stamp_us for each in transforms], np.float64)
    places = np.array([each.translation_m for each in transforms])
    turns = Rotation.from_quat([each.quaternion for each in transforms])
    if len(transforms) == 1:
        assert stamp_us == transforms[0].stamp_us
        return homogeneous(places[0], turns[0])
    place = np.array([np.interp(stamp_us, stamps, places[:, axis]) for axis in range(3)])
    return homogeneous(place, Slerp(stamps, turns)(stamp_us))


def homogeneous(translation_m: NDArray[np.float64], rotation: Rotation) -> NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.as_matrix()
    matrix[:3, 3] = translation_m
    return matrix


def pose_in_root(edges: dict[str, list[Transform]], frame: str, stamp_us: int) -> NDArray[np.float64]:
    """Up to the frame that is nobody's child."""
    matrix = np.eye(4)
    while frame in edges:
        matrix = pose_at(edges[frame], stamp_us) @ matrix
        frame = edges[frame][0].parent
    return matrix
