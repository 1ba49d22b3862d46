from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rendered_room import CAMERA, plumb_bob
from semap_ingest.simulation.lens import lens_of

from semap.errors import InvalidInput


@given(st.floats(-1.1, 1.1), st.floats(-0.8, 0.8), st.floats(0.2, 30))
def test_points_fall_where_the_camera_model_says(x, y, z):
    point = np.array([x * z, y * z, z])
    assert lens_of(CAMERA).project(point[None])[0] == pytest.approx(plumb_bob(point), abs=1e-6)


def test_what_a_pixel_sees_falls_on_that_pixel():
    rays = lens_of(CAMERA).rays
    for row, column in ((0, 0), (479, 639), (240, 320), (17, 600), (450, 3)):
        assert plumb_bob([*rays[row, column], 1.0]) == pytest.approx([column, row], abs=1e-3)


def test_without_distortion_it_is_a_pinhole():
    for distortion in (np.zeros(0), np.zeros(5)):
        lens = lens_of(replace(CAMERA, distortion=distortion))
        assert lens.rays[400, 100] == pytest.approx([(100 - 319.5) / 320, (400 - 238) / 322], abs=1e-6)


def test_far_off_the_axis_nothing_folds_back_into_the_image():
    matrix = np.array([[700.0, 0.0, 319.5], [0.0, 700.0, 239.5], [0.0, 0.0, 1.0]])
    lens = lens_of(replace(CAMERA, matrix=matrix, distortion=np.array([-0.3, 0.0, 0.0, 0.0, 0.0])))
    # the radius seen, r - 0.3 r^3, is greatest there
    assert lens.reach == pytest.approx(1 / np.sqrt(0.9), abs=0.02)
    aside = np.column_stack([np.linspace(0.9, 100, 200), np.zeros(200), np.ones(200)])
    assert np.all(np.diff(lens.project(aside)[:, 0]) >= -1e-9)


def test_no_points_have_no_pixels():
    assert lens_of(CAMERA).project(np.zeros((0, 3))).shape == (0, 2)


def test_a_distortion_that_folds_the_image_is_refused():
    with pytest.raises(InvalidInput, match="corners"):
        lens_of(replace(CAMERA, distortion=np.array([-0.3, 0.0, 0.0, 0.0, 0.0])))


def test_a_fisheye_camera_is_refused():
    with pytest.raises(InvalidInput, match="fisheye") as refused:
        lens_of(replace(CAMERA, model="equidistant"))
    assert "plumb_bob" in refused.value.remedy
