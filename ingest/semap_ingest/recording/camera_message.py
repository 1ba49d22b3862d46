"""Images and camera models, out of sensor_msgs/Image, CompressedImage and CameraInfo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from semap_ingest.recording.header import frame_name, stamp_us
from semap_ingest.recording.passed_over import Unusable
from semap_ingest.sensing.image import Camera, CompressedImage, Image

Model = Literal["plumb_bob", "rational_polynomial", "equidistant"]


@dataclass(frozen=True)
class Layout:
    """How an encoding of sensor_msgs/image_encodings.hpp lies in memory.

    red_green_blue  which channel each colour is taken from
    conversion      OpenCV's name of it, where the channels are no colours
    """

    bytes: int
    channels: int
    red_green_blue: tuple[int, int, int] = (0, 1, 2)
    conversion: str = ""


GREY, REVERSED = (0, 0, 0), (2, 1, 0)
LAYOUTS: Mapping[str, Layout] = {
    "rgb8": Layout(1, 3),
    "rgba8": Layout(1, 4),
    "bgr8": Layout(1, 3, REVERSED),
    "bgra8": Layout(1, 4, REVERSED),
    "mono8": Layout(1, 1, GREY),
    "8uc1": Layout(1, 1, GREY),
    "8uc3": Layout(1, 3, REVERSED),  # OpenCV's own order, as cv_bridge takes it
    "8uc4": Layout(1, 4, REVERSED),
    "rgb16": Layout(2, 3),
    "rgba16": Layout(2, 4),
    "bgr16": Layout(2, 3, REVERSED),
    "bgra16": Layout(2, 4, REVERSED),
    "mono16": Layout(2, 1, GREY),
    "yuv422": Layout(1, 2, conversion="COLOR_YUV2RGB_UYVY"),
    "uyvy": Layout(1, 2, conversion="COLOR_YUV2RGB_UYVY"),
    "yuv422_yuy2": Layout(1, 2, conversion="COLOR_YUV2RGB_YUYV"),
    "yuyv": Layout(1, 2, conversion="COLOR_YUV2RGB_YUYV"),
    **{
        f"bayer_{pattern}{8 * size}": Layout(size, 1, conversion=f"COLOR_Bayer{pattern.upper()}2RGB")
        for pattern in ("rggb", "bggr", "gbrg", "grbg")
        for size in (1, 2)
    },
}

DEPTHS = ("16uc1", "32fc1")
"""Encodings of distances, as the format of a compressed image names them."""
NO_COLOURS = "distances and no colours"


def is_depth(flaw: str) -> bool:
    """Whether that is what is wrong with an image."""
    return NO_COLOURS in flaw


LENGTHS: Mapping[str, tuple[Model, tuple[int, ...]]] = {
    "": ("plumb_bob", (4, 5)),
    "plumb_bob": ("plumb_bob", (4, 5)),
    "rational_polynomial": ("rational_polynomial", (8, 12, 14)),
    "equidistant": ("equidistant", (4,)),
    "fisheye": ("equidistant", (4,)),
}
"""By name in CameraInfo: the model, and how many coefficients it may have."""
MOST_USED = 8
"""Of the coefficients: what OpenCV has after them is for thin prisms and tilted sensors."""


def decode_image(message: Any, log_us: int) -> Image:
    """The picture with red first; of 16 bits the upper 8 are kept.

    raises  Unusable for an encoding that is not among LAYOUTS, or fewer bytes than rows need
    """
    layout = LAYOUTS.get(message.encoding.lower())
    if message.encoding.lower() in DEPTHS:
        raise Unusable(f"an image of {message.encoding}, which are {NO_COLOURS}")
    if layout is None:
        raise Unusable(f"the encoding {message.encoding!r} is not one of {', '.join(LAYOUTS)}")
    stored = _stored(message, layout)
    pixels = _converted(stored, layout) if layout.conversion else _picked(stored, layout)
    return Image(stamp_us(message.header.stamp, log_us), frame_name(message.header.frame_id), pixels)


def decode_compressed_image(message: Any, log_us: int) -> CompressedImage:
    """raises Unusable for a compressed depth image, which has a header of its own before the PNG"""
    if "compresseddepth" in message.format.lower():
        raise Unusable(f"a compressed depth image, which are {NO_COLOURS}")
    encoding = message.format.partition(";")[0].strip().lower()
    if encoding in DEPTHS:
        raise Unusable(f"an image of {encoding.upper()}, which are {NO_COLOURS}")
    if len(message.data) == 0:
        raise Unusable("an image of no bytes")
    return CompressedImage(
        stamp_us(message.header.stamp, log_us), frame_name(message.header.frame_id), message.data.tobytes()
    )


def decode_camera(message: Any, _: int) -> Camera:
    """The model of the images as they come, at all times: binning and region of interest are worked into it.

    raises  Unusable for a camera that is not calibrated, or a distortion that semap does not know
    """
    matrix = np.array(_either(message, "k", "K"), np.float64).reshape(3, 3)
    distortion = np.array(_either(message, "d", "D"), np.float64)
    if not (np.isfinite(matrix).all() and np.isfinite(distortion).all() and matrix[0, 0] > 0 < matrix[1, 1]):
        raise Unusable("the camera is not calibrated: its matrix K has no focal length")
    model: Model = "plumb_bob"
    if distortion.any():
        model = _model(message.distortion_model, distortion)
        distortion = distortion[:MOST_USED]
    else:
        distortion = np.zeros(0)
    area, binning = message.roi, np.maximum((message.binning_x, message.binning_y), 1)
    size = np.array([area.width or message.width, area.height or message.height]) // binning
    if not size.all():
        raise Unusable("the camera's images have no size")
    projection = np.array(_either(message, "p", "P"), np.float64).reshape(3, 4)[:, :3]
    has_projection = np.isfinite(projection).all() and projection[0, 0] > 0 < projection[1, 1]
    for each in (matrix, projection):
        each[:2, 2] -= area.x_offset, area.y_offset
        each[:2] /= binning[:, None]
    return Camera(
        frame_name(message.header.frame_id),
        int(size[0]),
        int(size[1]),
        matrix,
        distortion,
        model,
        projection if has_projection else None,
    )


def _stored(message: Any, layout: Layout) -> NDArray[Any]:
    """(height, width, channels) of the message's bytes, which rows may fill only in part."""
    height, width, step = message.height, message.width, message.step
    row = width * layout.channels * layout.bytes
    if not (height and width):
        raise Unusable("an image without pixels")
    if step < row or len(message.data) < (height - 1) * step + row:
        raise Unusable(
            f"{len(message.data)} bytes in rows of {step} for {width}x{height} pixels of {message.encoding}"
        )
    kind = np.dtype(f"{'>' if message.is_bigendian else '<'}u{layout.bytes}")
    return np.ndarray(
        (height, width, layout.channels),
        kind,
        message.data,
        strides=(step, layout.channels * layout.bytes, layout.bytes),
    )


def _picked(stored: NDArray[Any], layout: Layout) -> NDArray[np.uint8]:
    """Red, green and blue; the bytes of the message themselves where they lie so already."""
    if layout == LAYOUTS["rgb8"]:
        return np.ascontiguousarray(stored)
    pixels = np.empty((*stored.shape[:2], 3), np.uint8)
    for colour, channel in enumerate(layout.red_green_blue):  # several times as fast as all at once
        pixels[..., colour] = stored[..., channel] if layout.bytes == 1 else stored[..., channel] >> 8
    return pixels


def _converted(stored: NDArray[Any], layout: Layout) -> NDArray[np.uint8]:
    height, width = stored.shape[:2]
    if layout.channels == 2 and width % 2:
        raise Unusable("two pixels share their colour in YUV 4:2:2, and this image has an odd width")
    if layout.channels == 1 and min(height, width) < 3:
        raise Unusable("a Bayer pattern of less than 3 x 3 pixels has no colours")
    try:
        import cv2  # noqa: PLC0415
    except ImportError as error:
        raise Unusable("converting YUV or Bayer needs OpenCV: pip install 'semap[perception]'") from error
    eight_bits = stored if layout.bytes == 1 else (stored >> 8).astype(np.uint8)
    conversion = getattr(cv2, layout.conversion)
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(eight_bits), conversion), np.uint8)


def _model(name: str, distortion: NDArray[np.float64]) -> Model:
    length = len(distortion)
    model, lengths = LENGTHS.get(name, (None, ()))
    if model is None:
        raise Unusable(f"the distortion model {name!r} is not one of {', '.join(get_args(Model))}")
    if length not in lengths:
        raise Unusable(f"the distortion model {name!r} with {length} coefficients")
    if distortion[MOST_USED:].any():
        raise Unusable(f"the distortion model {name!r} with terms for a thin prism or a tilted sensor")
    return model


def _either(message: Any, ros2: str, ros1: str) -> Any:
    return getattr(message, ros2) if hasattr(message, ros2) else getattr(message, ros1)
