"""Pictures and camera models in every form that drivers give them."""

import cv2
import numpy as np
import pytest
from bags import Ros
from semap_ingest.recording.camera_message import (
    LAYOUTS,
    decode_camera,
    decode_compressed_image,
    decode_image,
)
from semap_ingest.recording.passed_over import Unusable

ROS = {True: Ros(is_ros1=True), False: Ros(is_ros1=False)}
PICTURE = np.random.default_rng(5).integers(0, 256, (5, 6, 3), dtype=np.uint8)
GREY = cv2.cvtColor(PICTURE, cv2.COLOR_RGB2GRAY)
AS_CV = {
    "rgb8": PICTURE,
    "bgr8": cv2.cvtColor(PICTURE, cv2.COLOR_RGB2BGR),
    "8UC3": cv2.cvtColor(PICTURE, cv2.COLOR_RGB2BGR),
    "rgba8": cv2.cvtColor(PICTURE, cv2.COLOR_RGB2RGBA),
    "bgra8": cv2.cvtColor(PICTURE, cv2.COLOR_RGB2BGRA),
    "8UC4": cv2.cvtColor(PICTURE, cv2.COLOR_RGB2BGRA),
    "mono8": GREY,
    "8UC1": GREY,
}
K = [500.0, 0, 320, 0, 510, 240, 0, 0, 1]


def image(encoding: str, stored: np.ndarray, padding: int = 0, big_endian: bool = False):
    """A message of these pixels, each row followed by some bytes that are no pixels."""
    height, width = stored.shape[:2]
    rows = stored.reshape(height, -1)
    rows = rows.astype(rows.dtype.newbyteorder(">" if big_endian else "<")).view(np.uint8)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=99)
    message = ROS[False].image(0, encoding, height, width, padded.shape[1], padded.tobytes())
    message.is_bigendian = int(big_endian)
    return message


@pytest.mark.parametrize("padding", [0, 3])
@pytest.mark.parametrize("encoding", AS_CV)
def test_colours_come_red_first(encoding: str, padding: int) -> None:
    expected = PICTURE if AS_CV[encoding].ndim == 3 else cv2.cvtColor(GREY, cv2.COLOR_GRAY2RGB)
    found = decode_image(image(encoding, AS_CV[encoding], padding), 0).pixels
    np.testing.assert_array_equal(found, expected)
    assert found.flags.c_contiguous
    assert found.dtype == np.uint8


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("encoding", ["mono16", "rgb16", "bgra16"])
def test_of_16_bits_the_upper_8_are_kept(encoding: str, big_endian: bool) -> None:
    eight = {"mono16": "mono8", "rgb16": "rgb8", "bgra16": "bgra8"}[encoding]
    wide = AS_CV[eight].astype(np.uint16) * 256 + 77
    found = decode_image(image(encoding, wide, 4, big_endian), 0).pixels
    np.testing.assert_array_equal(found, decode_image(image(eight, AS_CV[eight]), 0).pixels)


@pytest.mark.parametrize(
    ("encoding", "order"), [("yuv422", "UYVY"), ("uyvy", "UYVY"), ("yuv422_yuy2", "YUYV"), ("yuyv", "YUYV")]
)
def test_yuv_becomes_its_colour(encoding: str, order: str) -> None:
    """BT.601 in studio range, two pixels to a pair of chroma."""
    colour = np.array([200.0, 120, 40]) / 255
    parts = {
        "Y": 16 + np.dot([65.481, 128.553, 24.966], colour),
        "U": 128 + np.dot([-37.797, -74.203, 112.0], colour),
        "V": 128 + np.dot([112.0, -93.786, -18.214], colour),
    }
    stored = np.tile(np.array([round(parts[each]) for each in order], np.uint8), (4, 3)).reshape(4, 6, 2)
    found = decode_image(image(encoding, stored, 2), 0).pixels
    np.testing.assert_allclose(found, np.broadcast_to([200, 120, 40], (4, 6, 3)), atol=2)


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_bayer_pattern_becomes_its_colour(pattern: str) -> None:
    """Named by its first four pixels, two and two."""
    colour = {"r": 200, "g": 120, "b": 40}
    four = np.array([colour[each] for each in pattern], np.uint8).reshape(2, 2)
    stored = np.tile(four, (3, 4))
    expected = np.broadcast_to([200, 120, 40], (6, 8, 3))
    np.testing.assert_array_equal(decode_image(image(f"bayer_{pattern}8", stored, 3), 0).pixels, expected)
    wide = image(f"bayer_{pattern}16", stored.astype(np.uint16) * 256 + 77, 2, big_endian=True)
    np.testing.assert_array_equal(decode_image(wide, 0).pixels, expected)


@pytest.mark.parametrize("shape", [(1, 1), (2, 4), (4, 2), (3, 5)])
def test_a_small_or_odd_bayer_pattern(shape: tuple[int, int]) -> None:
    message = image("bayer_rggb8", np.full(shape, 9, np.uint8))
    if min(shape) < 3:
        with pytest.raises(Unusable, match="Bayer"):
            decode_image(message, 0)
    else:
        assert decode_image(message, 0).pixels.shape == (*shape, 3)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"encoding": "32FC1"}, "an image of 32FC1, which are distances"),
        ({"encoding": ""}, "the encoding ''"),
        ({"height": 0}, "without pixels"),
        ({"width": 2**31}, "bytes in rows"),
        ({"height": 2**31}, "bytes in rows"),
        ({"step": 17}, "bytes in rows"),
        ({"step": 19}, "bytes in rows"),
        ({"data": np.zeros(0, np.uint8)}, "0 bytes in rows"),
        ({"encoding": "uyvy", "width": 5}, "odd width"),
    ],
)
def test_a_picture_that_is_none(change: dict[str, object], said: str) -> None:
    message = image("rgb8", PICTURE)
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(Unusable, match=said):
        decode_image(message, 0)


def test_every_layout_is_tried() -> None:
    tried = {name.lower() for name in AS_CV} | {"mono16", "rgb16", "bgra16", "rgba16", "bgr16"}
    tried |= {"yuv422", "uyvy", "yuv422_yuy2", "yuyv"}
    bayer = {f"bayer_{each}{bits}" for each in ("rggb", "bggr", "gbrg", "grbg") for bits in (8, 16)}
    assert set(LAYOUTS) == tried | bayer


def test_a_compressed_depth_image_is_none() -> None:
    for message in (
        ROS[False].compressed(0, b"12 bytes....\x89PNG", "16UC1; compressedDepth png"),
        ROS[False].compressed(0, b""),
    ):
        with pytest.raises(Unusable):
            decode_compressed_image(message, 0)


@pytest.mark.parametrize("is_ros1", [True, False])
def test_binning_and_region_are_worked_into_the_matrix(is_ros1: bool) -> None:
    """A point seen at (x, y) of the whole sensor is at ((x - left) / 2, (y - top) / 3) of the image."""
    area = {"x_offset": 100, "y_offset": 60, "width": 400, "height": 300}
    camera = decode_camera(ROS[is_ros1].camera(K, [], roi=area, binning_x=2, binning_y=3), 0)
    assert (camera.width_px, camera.height_px) == (200, 100)
    ray = np.array([0.1, -0.2, 1])
    x, y, _ = np.array(K).reshape(3, 3) @ ray
    np.testing.assert_allclose(camera.matrix @ ray, [(x - 100) / 2, (y - 60) / 3, 1])


@pytest.mark.parametrize(
    ("name", "distortion", "model", "length"),
    [
        ("plumb_bob", [0.1, 0.2, 0, 0], "plumb_bob", 4),
        ("plumb_bob", [0.1, 0.2, 0, 0, 0], "plumb_bob", 5),
        ("plumb_bob", [0] * 8, "plumb_bob", 0),
        ("rational_polynomial", [0.1] * 8, "rational_polynomial", 8),
        ("rational_polynomial", [0.1] * 8 + [0] * 4, "rational_polynomial", 8),
        ("rational_polynomial", [0.1] * 8 + [0] * 6, "rational_polynomial", 8),
        ("equidistant", [0.1] * 4, "equidistant", 4),
        ("fisheye", [0.1] * 4, "equidistant", 4),
        ("", [], "plumb_bob", 0),
        ("none", [], "plumb_bob", 0),
    ],
)
def test_distortion(name: str, distortion: list[float], model: str, length: int) -> None:
    camera = decode_camera(ROS[False].camera(K, distortion, name), 0)
    assert (camera.model, len(camera.distortion)) == (model, length)


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (ROS[False].camera([0.0] * 9, []), "not calibrated"),
        (ROS[False].camera([np.nan, *K[1:]], []), "not calibrated"),
        (ROS[False].camera(K, [np.inf, 0, 0, 0, 0]), "not calibrated"),
        (ROS[False].camera(K, [0.1] * 7), "with 7 coefficients"),
        (ROS[False].camera(K, [0.1] * 12, "rational_polynomial"), "thin prism"),
        (ROS[False].camera(K, [0.1] * 4, "double_sphere"), "'double_sphere' is not one of plumb_bob"),
        (ROS[False].camera(K, [], width=0), "no size"),
        (ROS[True].camera(K, [], binning_x=2**20), "no size"),
    ],
)
def test_a_camera_that_cannot_be_used(message: object, said: str) -> None:
    with pytest.raises(Unusable, match=said):
        decode_camera(message, 0)
