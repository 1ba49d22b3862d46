"""In which form a network wants its image: how it fits in, order of colours, range of values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from semap_ingest.image.letterbox import Fit, Letterbox
from semap_ingest.image.tensor import ImageInput

Triple = tuple[float, float, float]

IMAGENET_MEAN: Triple = (0.485, 0.456, 0.406)
IMAGENET_STD: Triple = (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class InputForm:
    """The input is (pixel / full_scale - mean) / std; an input of bytes gets the pixels as they are.

    full_scale  255: values from 0 to 1; 1: values from 0 to 255
    mean, std   of red, green and blue, after the division; IMAGENET_MEAN and IMAGENET_STD are the usual ones
    padding     grey value around an image that does not fill the input
    """

    fit: Fit = "centre"
    colours: Literal["rgb", "bgr"] = "rgb"
    full_scale: float = 255.0
    mean: Triple = (0.0, 0.0, 0.0)
    std: Triple = (1.0, 1.0, 1.0)
    padding: int = 114


def prepare(pixels: NDArray[np.uint8], form: InputForm, to: ImageInput) -> tuple[NDArray[Any], Letterbox]:
    """Make the input of a network from an image.

    pixels   (height, width, 3), red first
    returns  (1, 3, h, w) or (1, h, w, 3) of the type that the input has, and where the image lies in it
    """
    height, width = pixels.shape[:2]
    letterbox = Letterbox.place((width, height), to.size_px, form.fit)
    filled = letterbox.fill(pixels, form.padding)
    planes = cv2.split(filled)
    order = (0, 1, 2) if form.colours == "rgb" else (2, 1, 0)
    bytes_wanted = to.dtype == np.uint8
    tensor = np.empty((1, *to.shape), dtype=np.uint8 if bytes_wanted else np.float32)
    for channel, colour in enumerate(order):
        plane = tensor[0, channel] if to.is_channels_first else tensor[0, :, :, channel]
        if bytes_wanted:
            plane[...] = planes[colour]
        else:
            np.multiply(planes[colour], np.float32(1 / (form.full_scale * form.std[colour])), out=plane)
            if form.mean[colour]:
                plane -= np.float32(form.mean[colour] / form.std[colour])
    return tensor.astype(to.dtype, copy=False), letterbox
