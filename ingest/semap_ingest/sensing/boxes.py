"""What an image detector found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Boxes:
    """Rectangles in one image.

    corners_px  (n, 4) float64 x_min, y_min, x_max, y_max [px, origin top left of the image as it came]
    score       (n,) 0 to 1
    label       (n,) class names
    track       (n,) int64, the image track that each belongs to; -1 before the image tracker has seen them
    """

    stamp_us: int
    frame: str
    corners_px: NDArray[np.float64]
    score: NDArray[np.float64]
    label: tuple[str, ...]
    track: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.corners_px)
