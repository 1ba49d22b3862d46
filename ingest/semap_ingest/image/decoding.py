"""A camera's JPEG or PNG becomes pixels.

A file that cannot be decoded whole is a value and not an error: a camera on a bad line sends one now and
then, and the next image is a thirtieth of a second away. Half a picture is broken too: people would be cut
off where it ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from semap_ingest.image.file_header import JPEG, PNG, size_px
from semap_ingest.sensing.image import CompressedImage, Image

JPEG_END = b"\xff\xd9"
PNG_END = b"IEND\xaeB`\x82"
MOST_BYTES_AFTER_END = 64
MOST_PIXELS = 2**26
# The header's orientation is for photographs; camera_info describes the sensor's own rows and columns.
AS_IT_CAME = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION


@dataclass(frozen=True)
class BrokenImage:
    """An image that came, and nothing can be seen in it."""

    stamp_us: int
    frame: str
    reason: str


def decode(image: CompressedImage) -> Image | BrokenImage:
    """Decode an 8 or 16 bit JPEG or PNG; grey becomes three equal channels, transparency is left out."""
    reason = _reason_against(image.data)
    if reason:
        return BrokenImage(image.stamp_us, image.frame, reason)
    try:
        blue_first = cv2.imdecode(np.frombuffer(image.data, dtype=np.uint8), AS_IT_CAME)
    except cv2.error as error:
        return BrokenImage(image.stamp_us, image.frame, str(error.err or error))
    if blue_first is None:
        return BrokenImage(image.stamp_us, image.frame, "the data are damaged")
    pixels = np.asarray(cv2.cvtColor(blue_first, cv2.COLOR_BGR2RGB), dtype=np.uint8)
    return Image(image.stamp_us, image.frame, pixels)


def _reason_against(data: bytes) -> str:
    if data.startswith(JPEG):
        end = JPEG_END
    elif data.startswith(PNG):
        end = PNG_END
    else:
        return "neither JPEG nor PNG" if data else "no data"
    # Some cameras fill their buffer with zeros, or a few bytes of anything, after the end.
    tail = data.rstrip(b"\0")[-MOST_BYTES_AFTER_END - len(end) :]
    if end not in tail:
        return "the end of the file is missing"
    width, height = size_px(data) or (0, 0)
    if not 0 < width * height <= MOST_PIXELS:
        return f"the header is damaged: {width} x {height} px"
    return ""
