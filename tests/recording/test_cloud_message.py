"""Points of a cloud, wherever they lie in its bytes."""

import numpy as np
import pytest
from bags import Ros
from hypothesis import given
from hypothesis import strategies as st
from semap_ingest.recording.cloud_message import decode_cloud
from semap_ingest.recording.passed_over import Unusable

ROS = Ros(is_ros1=False)
FLAT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4")])


@st.composite
def layouts(draw: st.DrawFn) -> np.dtype:
    """x, y and z among others, in any order and with gaps, of either byte order."""
    order = draw(st.sampled_from("<>"))
    names = draw(st.permutations(["x", "y", "z", "intensity", "ring"]))
    offsets, formats, end = [], [], 0
    for name in names:
        formats.append(order + (draw(st.sampled_from(["f4", "f8"])) if name in "xyz" else "u2"))
        offsets.append(end + draw(st.integers(0, 5)))
        end = offsets[-1] + np.dtype(formats[-1]).itemsize
    size = end + draw(st.integers(0, 9))
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


@given(layouts(), st.integers(1, 4), st.integers(1, 5), st.integers(0, 7), st.randoms(use_true_random=False))
def test_points_are_found_in_any_layout(
    layout: np.dtype, height: int, width: int, padding: int, random
) -> None:
    rng = np.random.default_rng(random.randrange(2**32))
    points = np.frombuffer(rng.bytes(height * width * layout.itemsize), layout).copy().reshape(height, width)
    expected = rng.normal(size=(height, width, 3)).astype(np.float32)
    expected[rng.random((height, width)) < 0.2, rng.integers(3)] = rng.choice([np.nan, np.inf, -np.inf])
    for index, axis in enumerate("xyz"):
        points[axis] = expected[..., index]
    rows = points.view(np.uint8).reshape(height, -1)
    data = np.pad(rows, ((0, 0), (0, padding))).ravel()[: rows.size + padding * (height - 1)]
    message = ROS.cloud(
        0,
        points,
        height=height,
        width=width,
        row_step=rows.shape[1] + padding,
        is_bigendian=layout["x"].str[0] == ">",
        data=data,
    )
    flat = expected.reshape(-1, 3)
    np.testing.assert_array_equal(decode_cloud(message, 0).points_m, flat[np.isfinite(flat).all(axis=1)])


@pytest.mark.parametrize("shape", [{"height": 0}, {"width": 0}, {}])
def test_a_cloud_without_points(shape: dict[str, int]) -> None:
    found = decode_cloud(ROS.cloud(5_000, np.zeros(0, FLAT), **shape), 7).points_m
    assert (found.shape, found.dtype) == ((0, 3), np.float32)


def test_a_row_step_that_was_left_out() -> None:
    points = np.ones(4, FLAT)
    assert len(decode_cloud(ROS.cloud(0, points, row_step=0), 0).points_m) == 4


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"width": 2**32 - 1}, "bytes in rows"),
        ({"height": 2, "width": 2, "row_step": 20}, "bytes in rows"),
        ({"height": 2**32 - 1, "row_step": 48}, "bytes in rows"),
        ({"point_step": 8}, "points of 8 bytes"),
        ({"point_step": 0}, "points of 0 bytes"),
        ({"data": np.zeros(47, np.uint8)}, "47 bytes"),
        ({"fields": []}, "without x, y, z"),
    ],
)
def test_a_cloud_that_is_none(change: dict[str, object], said: str) -> None:
    message = ROS.cloud(0, np.ones(4, FLAT))
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(Unusable, match=said):
        decode_cloud(message, 0)


def test_a_coordinate_of_an_unknown_datatype() -> None:
    message = ROS.cloud(0, np.ones(4, FLAT))
    message.fields[1].datatype = 9
    with pytest.raises(Unusable, match="unknown datatype 9"):
        decode_cloud(message, 0)
