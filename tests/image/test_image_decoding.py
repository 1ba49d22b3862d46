"""JPEG and PNG files of all kinds, whole and broken."""

import cv2
import numpy as np
import pytest
from data_sets import data_set
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from semap_ingest.image.decoding import BrokenImage, decode
from semap_ingest.image.file_header import size_px
from semap_ingest.sensing.image import CompressedImage, Image


def gradient() -> NDArray[np.uint8]:
    """(48, 64, 3), red to the right, green downwards, blue 40."""
    pixels = np.full((48, 64, 3), 40, dtype=np.uint8)
    pixels[:, :, 0] = np.arange(64) * 4
    pixels[:, :, 1] = np.arange(48)[:, None] * 5
    return pixels


def file_of(pixels: NDArray[np.generic], ending: str) -> bytes:
    swapped = pixels[..., ::-1] if pixels.ndim == 3 else pixels
    return bytes(cv2.imencode(ending, np.ascontiguousarray(swapped))[1].tobytes())


def seen(data: bytes) -> Image:
    image = decode(CompressedImage(5, "camera_optical", data))
    assert isinstance(image, Image)
    assert (image.stamp_us, image.frame, image.pixels.dtype) == (5, "camera_optical", np.uint8)
    return image


def reason(data: bytes) -> str:
    image = decode(CompressedImage(5, "camera_optical", data))
    assert isinstance(image, BrokenImage)
    assert (image.stamp_us, image.frame) == (5, "camera_optical")
    return image.reason


def test_png_gives_the_pixels_red_first() -> None:
    np.testing.assert_array_equal(seen(file_of(gradient(), ".png")).pixels, gradient())


def test_jpeg_gives_nearly_the_pixels() -> None:
    assert np.abs(seen(file_of(gradient(), ".jpg")).pixels.astype(int) - gradient()).mean() < 4


@pytest.mark.parametrize("ending", [".png", ".jpg"])
def test_grey_becomes_three_channels(ending: str) -> None:
    pixels = seen(file_of(gradient()[:, :, 0], ending)).pixels
    assert pixels.shape == (48, 64, 3)
    assert (pixels == pixels[:, :, :1]).all()


def test_sixteen_bits_become_eight_and_transparency_goes() -> None:
    deep = gradient().astype(np.uint16) * 256
    np.testing.assert_array_equal(seen(file_of(deep, ".png")).pixels, gradient())
    see_through = cv2.cvtColor(gradient(), cv2.COLOR_RGB2BGRA)
    see_through[:, :, 3] = 7
    np.testing.assert_array_equal(
        seen(bytes(cv2.imencode(".png", see_through)[1].tobytes())).pixels, gradient()
    )


def test_the_header_does_not_turn_the_image() -> None:
    """Orientation 6, a quarter turn, in the header of a photograph."""
    jpeg = file_of(gradient(), ".jpg")
    entry = b"\x01\x12\x00\x03\x00\x00\x00\x01\x00\x06\x00\x00"
    exif = b"Exif\0\0MM\x00\x2a\x00\x00\x00\x08\x00\x01" + entry + b"\0\0\0\0"
    turned = jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
    assert cv2.imdecode(np.frombuffer(turned, np.uint8), cv2.IMREAD_COLOR).shape == (64, 48, 3)
    np.testing.assert_array_equal(seen(turned).pixels, seen(jpeg).pixels)


def test_what_a_camera_leaves_after_the_end() -> None:
    jpeg = file_of(gradient(), ".jpg")
    whole = seen(jpeg).pixels
    for rest in (b"\0" * 10_000, b"\x17\x2a\x00\x01", b"\xff" * 30 + b"\0" * 99):
        np.testing.assert_array_equal(seen(jpeg + rest).pixels, whole)


@pytest.mark.parametrize(
    ("data", "why"),
    [(b"", "no data"), (b"\0" * 900, "neither"), (b"GIF89a", "neither"), (b"\xff\xd8\xff\xd9", "0 x 0")],
)
def test_what_is_no_image(data: bytes, why: str) -> None:
    assert why in reason(data)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_a_truncated_file_is_broken_wherever_it_ends(ending: str) -> None:
    data = file_of(gradient(), ending)
    for end in range(len(data) - (3 if ending == ".png" else 1)):
        assert reason(data[:end])
    assert reason(data[: len(data) // 2] + b"\0" * 5000)


@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_a_size_that_no_camera_has_is_not_believed(ending: str) -> None:
    """One byte or two, for which the decoder would take gigabytes and half a minute."""
    data = bytearray(file_of(gradient(), ending))
    at = data.index(b"\xff\xc0") + 5 if ending == ".jpg" else data.index(b"IHDR") + 4
    data[at : at + (4 if ending == ".jpg" else 8)] = (
        b"\x7d\x00\x7d\x00" if ending == ".jpg" else b"\0\0\x7d\0" * 2
    )
    assert reason(bytes(data)) == "the header is damaged: 32000 x 32000 px"


def test_the_size_is_found_behind_other_segments() -> None:
    jpeg = file_of(gradient(), ".jpg")
    comment = b"\xff\xff\xff\xfe\x00\x09\xff\xc0\xff\xc0abc"
    assert size_px(jpeg[:2] + comment + jpeg[2:]) == (64, 48)
    assert size_px(jpeg[:2] + b"\xff\xfe\x00\x01" + jpeg[2:]) is None
    assert size_px(b"GIF89a") is None


@settings(max_examples=60)
@given(st.data())
def test_flipped_bytes_never_raise(data: st.DataObject) -> None:
    ending = data.draw(st.sampled_from([".jpg", ".png"]))
    broken = bytearray(file_of(gradient(), ending))
    for _ in range(data.draw(st.integers(1, 4))):
        broken[data.draw(st.integers(0, len(broken) - 1))] = data.draw(st.integers(0, 255))
    image = decode(CompressedImage(0, "camera_optical", bytes(broken)))
    assert isinstance(image, Image | BrokenImage)


def test_a_photograph_and_half_of_it() -> None:
    data = (data_set("detector") / "coco" / "000000000785.jpg").read_bytes()
    assert seen(data).pixels.shape == (425, 640, 3)
    assert reason(data[: len(data) // 2]) == "the end of the file is missing"
