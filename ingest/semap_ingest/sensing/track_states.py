"""What a map tracker says: where its tracks are, which ended, and what it had mistaken before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class TrackAmendment:
    """What turned out later.

    merged    `track` and `other` are one person since `since_us`; `other` is the older one, which goes on
    switched  from `since_us` on, what `track` followed was the person of `other`, and the other way round
    """

    kind: Literal["merged", "switched"]
    track: int
    other: int
    since_us: int
    found_us: int


@dataclass(frozen=True, eq=False)
class TrackStates:
    """Confirmed tracks that were seen at one moment.

    track          (n,) int64, numbered from 1 in the order of their confirmation, never used again
    position_m     (n, 2) [m, frame]
    velocity_mps   (n, 2)
    covariance_m2  (n, 2, 2) of the position
    extent_m       (n, 2) length (along the heading) and width of the footprint
    heading_rad    (n,) where it faces, as far as walking tells; NaN before it has walked
    ended          tracks that are over, each with the stamp [us] at which it was last seen
    """

    stamp_us: int
    frame: str
    track: NDArray[np.int64]
    position_m: NDArray[np.float64]
    velocity_mps: NDArray[np.float64]
    covariance_m2: NDArray[np.float64]
    extent_m: NDArray[np.float64]
    heading_rad: NDArray[np.float64]
    ended: tuple[tuple[int, int], ...] = ()
    amendments: tuple[TrackAmendment, ...] = ()

    def __len__(self) -> int:
        return len(self.track)
