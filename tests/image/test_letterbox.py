"""The way into a network's input and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from semap_ingest.image.input_form import IMAGENET_MEAN, IMAGENET_STD, InputForm, prepare
from semap_ingest.image.letterbox import Fit, Letterbox
from semap_ingest.image.tensor import ImageInput


def to_input(letterbox: Letterbox, corners: list[float]) -> list[float]:
    """From the image to the input, one corner at a time."""
    (wide, high), (inner_wide, inner_high) = letterbox.image_px, letterbox.inner_px
    left, top = letterbox.offset_px
    return [
        value * inner_wide / wide + left if axis % 2 == 0 else value * inner_high / high + top
        for axis, value in enumerate(corners)
    ]


SIDES = st.integers(1, 4000)
FITS = st.sampled_from(["stretch", "centre", "corner"])


@given(SIDES, SIDES, SIDES, SIDES, FITS, st.lists(st.floats(-5000, 5000), min_size=4, max_size=4))
def test_what_goes_in_comes_back(
    width: int, height: int, input_width: int, input_height: int, fit: Fit, corners: list[float]
) -> None:
    letterbox = Letterbox.place((width, height), (input_width, input_height), fit)
    there = np.array([to_input(letterbox, corners)])
    np.testing.assert_allclose(letterbox.to_image(there), [corners], rtol=1e-9, atol=1e-6)
    whole = np.array(to_input(letterbox, [0.0, 0.0, width, height]))
    assert (whole[:2] >= 0).all()
    assert (whole[2:] <= np.array([input_width, input_height]) + 1e-9).all()
    touches = np.isclose(whole[2:] - whole[:2], [input_width, input_height])
    assert touches.all() if fit == "stretch" else touches.any()


@given(SIDES, SIDES, SIDES, SIDES)
def test_proportions_are_kept_to_half_a_pixel(width: int, height: int, wide: int, high: int) -> None:
    inner = Letterbox.place((width, height), (wide, high), "centre").inner_px
    ratio = min(wide / width, high / height)
    assert abs(inner[0] - max(1, width * ratio)) <= 0.5 + 1e-9
    assert abs(inner[1] - max(1, height * ratio)) <= 0.5 + 1e-9


@pytest.mark.parametrize("fit", ["stretch", "centre", "corner"])
def test_pixels_lie_where_the_letterbox_says(fit: Fit) -> None:
    """A white rectangle in the image is found in the input at the corners that it is said to have."""
    pixels = np.zeros((300, 500, 3), dtype=np.uint8)
    pixels[90:210, 100:400] = 255
    letterbox = Letterbox.place((500, 300), (416, 352), fit)
    filled = letterbox.fill(pixels, padding=0)
    assert filled.shape == (352, 416, 3)
    lines, columns = np.nonzero(filled[:, :, 0] > 127)
    seen = [columns.min(), lines.min(), columns.max() + 1, lines.max() + 1]
    scale = np.tile(np.array(letterbox.image_px) / np.array(letterbox.inner_px), 2)
    back = letterbox.to_image(np.array([seen], dtype=np.float64))[0]
    np.testing.assert_array_less(np.abs(back - [100, 90, 400, 210]), 0.51 * scale)


def test_padding_is_around_the_image() -> None:
    pixels = np.full((240, 640, 3), 200, dtype=np.uint8)
    filled = Letterbox.place((640, 240), (320, 320), "centre").fill(pixels, padding=114)
    assert (filled[:100] == 114).all()
    assert (filled[100:220] == 200).all()
    assert (filled[220:] == 114).all()


FORMS = {
    "yolo": (InputForm(), lambda rgb: rgb / 255),
    "megvii": (InputForm(colours="bgr", full_scale=1.0), lambda rgb: rgb[::-1]),
    "imagenet": (
        InputForm(mean=IMAGENET_MEAN, std=IMAGENET_STD),
        lambda rgb: (rgb / 255 - np.array([0.485, 0.456, 0.406])) / np.array([0.229, 0.224, 0.225]),
    ),
    "imagenet bgr": (
        InputForm(colours="bgr", mean=IMAGENET_MEAN, std=IMAGENET_STD),
        lambda rgb: ((rgb / 255 - np.array([0.485, 0.456, 0.406])) / np.array([0.229, 0.224, 0.225]))[::-1],
    ),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("is_channels_first", [True, False])
@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_colours_and_range(form: str, is_channels_first: bool, dtype: type[np.generic]) -> None:
    rgb = np.array([250.0, 128.0, 3.0])
    tensor, _ = prepare(
        np.full((24, 32, 3), rgb, dtype=np.uint8),
        FORMS[form][0],
        ImageInput("images", dtype, (32, 24), is_channels_first),
    )
    assert tensor.dtype == dtype
    assert tensor.shape == ((1, 3, 24, 32) if is_channels_first else (1, 24, 32, 3))
    wanted = FORMS[form][1](rgb)
    planes: NDArray[np.float64] = np.moveaxis(tensor[0], 0 if is_channels_first else 2, -1).astype(np.float64)
    np.testing.assert_allclose(planes, np.broadcast_to(wanted, (24, 32, 3)), rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize(("colours", "wanted"), [("rgb", [250, 128, 3]), ("bgr", [3, 128, 250])])
def test_an_input_of_bytes_gets_the_pixels(colours: str, wanted: list[int]) -> None:
    pixels = np.full((24, 32, 3), [250, 128, 3], dtype=np.uint8)
    form = InputForm(colours=colours)  # type: ignore[arg-type]
    tensor, _ = prepare(pixels, form, ImageInput("images", np.uint8, (32, 24), is_channels_first=False))
    assert tensor.dtype == np.uint8
    assert (tensor == wanted).all()
