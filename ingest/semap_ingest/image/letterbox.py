"""How an image is laid into the input of a network, and boxes back onto the image.

Pixel coordinates are those of edges: an image of width w spans 0 to w, so that both ways are one scale and
one offset for each axis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Fit = Literal["stretch", "centre", "corner"]


@dataclass(frozen=True)
class Letterbox:
    """input = image * scale + offset, for x and for y.

    image_px, inner_px, input_px  width and height of the image, of what becomes of it, and of the whole input
    offset_px                     left and upper padding in the input
    """

    image_px: tuple[int, int]
    inner_px: tuple[int, int]
    input_px: tuple[int, int]
    offset_px: tuple[int, int]

    @classmethod
    def place(cls, image_px: tuple[int, int], input_px: tuple[int, int], fit: Fit) -> Letterbox:
        """Where an image goes.

        fit  stretch: over the whole input; centre, corner: as large as its proportions allow, in the middle
             or in the upper left corner
        """
        if fit == "stretch":
            return cls(image_px, input_px, input_px, (0, 0))
        ratio = min(input_px[0] / image_px[0], input_px[1] / image_px[1])
        inner = (max(1, round(image_px[0] * ratio)), max(1, round(image_px[1] * ratio)))
        if fit == "corner":
            return cls(image_px, inner, input_px, (0, 0))
        return cls(image_px, inner, input_px, ((input_px[0] - inner[0]) // 2, (input_px[1] - inner[1]) // 2))

    def fill(self, pixels: NDArray[np.uint8], padding: int) -> NDArray[np.uint8]:
        """The image in its place, and `padding` around it; both (height, width, 3)."""
        inner = pixels if self.inner_px == self.image_px else _resized(pixels, self.inner_px)
        if self.inner_px == self.input_px:
            return inner
        filled = np.full((self.input_px[1], self.input_px[0], 3), padding, dtype=np.uint8)
        left, top = self.offset_px
        filled[top : top + self.inner_px[1], left : left + self.inner_px[0]] = inner
        return filled

    def to_image(self, corners_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Corners x_min, y_min, x_max, y_max (n, 4), from px of the input to px of the image."""
        scale = np.array(self.inner_px) / np.array(self.image_px)
        moved: NDArray[np.float64] = (corners_px - np.tile(self.offset_px, 2)) / np.tile(scale, 2)
        return moved


def _resized(pixels: NDArray[np.uint8], size_px: tuple[int, int]) -> NDArray[np.uint8]:
    # cv2 does not take views with negative steps.
    resized = cv2.resize(np.ascontiguousarray(pixels), size_px, interpolation=cv2.INTER_LINEAR)
    return np.asarray(resized, dtype=np.uint8)
