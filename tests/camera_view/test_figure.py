import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rendered_room import body
from semap_ingest.simulation.figure import PARTS, SPHERE_COUNT, figures


def spheres(figure, part):
    index = next(list(each.spheres) for each in PARTS if each.name == part)
    return figure.centre_m[0, index], figure.radius_m[0, index]


angles = st.floats(-np.pi, np.pi)


@given(angles, st.floats(0, 2 * np.pi), st.floats(0, 1), st.floats(1.4, 2.0))
def test_limbs_keep_their_length_and_knees_bend_forward(heading, phase, swing, height_m):
    figure = figures([body(3, -2, heading=heading, phase=phase, swing=swing, height_m=height_m)])
    forward = np.array([np.cos(heading), np.sin(heading), 0])
    for side in ("left", "right"):
        (hip, knee), _ = spheres(figure, f"{side} thigh")
        (_, ankle), _ = spheres(figure, f"{side} shank")
        assert np.linalg.norm(knee - hip) == pytest.approx(0.245 * height_m, abs=1e-3)
        assert np.linalg.norm(ankle - knee) == pytest.approx(0.246 * height_m, abs=2e-3)
        assert (knee - (hip + ankle) / 2) @ forward > -1e-3


@given(angles, st.floats(0, 2 * np.pi), st.floats(0, 1))
def test_feet_stand_below_the_shins_and_on_the_floor(heading, phase, swing):
    walker = body(3, -2, heading=heading, phase=phase, swing=swing)
    figure = figures([walker])
    lowest = []
    for shin, side in zip(walker.shins_m, ("left", "right"), strict=True):
        centre, radius = spheres(figure, f"{side} foot")
        assert centre[0, :2] == pytest.approx(shin, abs=1e-9)
        lowest.append((centre[1:, 2] - radius[1:]).min())
    assert min(lowest) == pytest.approx(0.0, abs=0.012)
    assert max(lowest) < 0.1


def test_a_person_who_stands_is_as_tall_and_wide_as_said():
    figure = figures([body(0, 0, heading=0.0, height_m=1.8)])
    top = figure.centre_m[0, :, 2] + figure.radius_m[0]
    side = np.abs(figure.centre_m[0, :, 1]) + figure.radius_m[0]
    assert top.max() == pytest.approx(1.8, abs=0.01)
    assert side.max() == pytest.approx(0.25, abs=0.03)


def test_arms_go_with_the_leg_of_the_other_side():
    figure = figures([body(0, 0, heading=0.0, phase=0.0, swing=1.0)])
    ahead = {side: spheres(figure, f"{side} hand")[0][0, 0] for side in ("left", "right")}
    left_foot = spheres(figure, "left foot")[0][0, 0]
    assert left_foot > 0
    assert ahead["right"] > ahead["left"]


def test_persons_do_not_depend_on_each_other():
    crowd = [body(k, -k, heading=0.7 * k, phase=k, swing=k / 4, height_m=1.5 + 0.1 * k) for k in range(5)]
    together = figures(crowd)
    for k, person in enumerate(crowd):
        alone = figures([person])
        assert np.array_equal(together.centre_m[k], alone.centre_m[0])
        assert np.array_equal(together.radius_m[k], alone.radius_m[0])
        assert np.array_equal(together.colour[k], alone.colour[0])


def test_nobody_has_no_spheres():
    assert figures([]).centre_m.shape == (0, SPHERE_COUNT, 3)
