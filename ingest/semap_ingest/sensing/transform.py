"""Where a frame was in its parent, and what is known to stand at a pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Transform:
    """parent_T_child at a stamp.

    translation_m  (3,)
    quaternion     (4,), x y z w, of length 1
    is_static      holds at all times
    """

    stamp_us: int
    parent: str
    child: str
    translation_m: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    is_static: bool = False


@dataclass(frozen=True, eq=False)
class PersonPoses:
    """Persons that somebody else has found already, such as the robot's own perception.

    position_m     (n, 3) [m, frame]
    covariance_m2  (n, 2, 2) of x and y; NaN where it is not told
    score          (n,) probability that it is a person; 1 where it is not told
    known_as       (n) who each is to its finder; empty: it does not say, or says it of several
    """

    stamp_us: int
    frame: str
    position_m: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    score: NDArray[np.float64]
    known_as: tuple[str, ...]
