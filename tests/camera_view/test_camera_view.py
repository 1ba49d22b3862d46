import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendered_room import (
    CAMERA,
    GREEN,
    NOTHING,
    body,
    box_of,
    is_green,
    is_magenta,
    look,
    moment,
    pixel_of,
    pose,
    surfaces,
)  # fmt: skip
from semap_ingest.simulation.camera_view import CameraView

WALL = surfaces((((2.0, -3.0), (2.0, 3.0)), (0.0, 2.6), (200, 200, 200)))
DOORWAY = surfaces(
    (((2.0, -3.0), (2.0, -0.45)), (0.0, 2.6), (200, 200, 200)),
    (((2.0, 0.45), (2.0, 3.0)), (0.0, 2.6), (200, 200, 200)),
    (((2.0, -0.45), (2.0, 0.45)), (2.05, 2.6), (200, 200, 200)),
)


def leaf(angle):
    """Hinged at the right post of the doorway as one looks through it, open to the far side."""
    hinge = np.array([2.0, -0.45])
    return surfaces(
        ((hinge, hinge + 0.9 * np.array([np.sin(angle), np.cos(angle)])), (0.0, 2.05), (90, 120, 90))
    )


@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5, -2.0])
@pytest.mark.parametrize(("x_m", "y_m"), [(3.0, 0.0), (4.0, 3.0), (6.5, -4.0), (2.0, 0.7)])
def test_boxes_are_those_of_the_pixels(x_m, y_m, heading):
    view = look(body(x_m, y_m, heading=heading, phase=1.0, swing=0.8))
    assert view.corners_px[0] == pytest.approx(box_of(is_magenta(view.pixels)), abs=2.5)
    assert view.visible[0] == 1.0


def test_a_person_is_where_the_camera_model_says():
    place = pose(1.0, -2.0, 0.4, 1.1, 0.03)
    person = body(4.0, -0.5, height_m=1.8)
    box = look(person, place=place).corners_px[0]
    head, ground = (pixel_of((4.0, -0.5, z), place) for z in (1.8, 0.0))
    assert box[1] == pytest.approx(head[1], abs=2)
    assert box[3] == pytest.approx(ground[1], abs=6)
    assert (box[0] + box[2]) / 2 == pytest.approx(head[0], abs=4)


def test_one_who_reaches_beyond_the_image_has_a_box_that_ends_there():
    view = look(body(1.2, 1.0))
    left, top, right, bottom = view.corners_px[0]
    assert (left, bottom) == (-0.5, 479.5)
    assert top > 0
    assert right == pytest.approx(box_of(is_magenta(view.pixels))[2], abs=2.5)


def test_nobody_is_seen_behind_a_wall():
    view = look(body(3.5, 0.3), fixed=WALL)
    assert view.names == ("anna",)
    assert view.visible[0] == 0.0
    assert np.array_equal(view.pixels, look(fixed=WALL).pixels)


def test_a_leaf_hides_the_more_the_less_it_is_open():
    shares = []
    everything = is_magenta(look(body(4.0, 0.15), fixed=DOORWAY).pixels).sum()
    for angle in (0.0, 0.4, 0.8, 1.2, 1.57):
        view = look(body(4.0, 0.15), fixed=DOORWAY, leaves=leaf(angle))
        assert is_magenta(view.pixels).sum() / everything == pytest.approx(view.visible[0], abs=0.04)
        shares.append(view.visible[0])
    assert shares == sorted(shares)
    assert shares[0] == 0.0
    assert 0.1 < shares[2] < 0.9
    assert shares[-1] == 1.0


def test_the_nearer_person_hides_the_other_in_whatever_order_they_come():
    near, far = body(2.5, 0.0, name="near", clothes=GREEN), body(4.0, 0.2, name="far")
    one, other = look(near, far), look(far, near)
    seen = dict(zip(one.names, one.visible, strict=True))
    assert dict(zip(other.names, other.visible, strict=True)) == seen
    assert seen["near"] == 1.0
    alone = is_magenta(look(far).pixels).sum()
    assert seen["far"] == pytest.approx(is_magenta(one.pixels).sum() / alone, abs=0.06)
    assert 0.05 < seen["far"] < 0.95
    assert is_green(one.pixels).sum() == pytest.approx(is_green(look(near).pixels).sum(), rel=0.01)


def test_the_same_seeds_give_the_same_images_whatever_was_rendered_before():
    walker = moment(body(3, 0, phase=1.0, swing=1.0))

    def images(view, angles):
        return [view.render(walker, leaf(angle), np.random.default_rng([7, k])).pixels for k, angle in angles]

    one, other = (CameraView(CAMERA, pose(), DOORWAY, np.random.default_rng(3)) for _ in range(2))
    forth = images(one, [(0, 0.2), (1, 0.2), (2, 1.1)])
    back = images(other, [(2, 1.1), (1, 0.2), (0, 0.2)])
    assert all(np.array_equal(a, b) for a, b in zip(forth, reversed(back), strict=True))
    assert not np.array_equal(forth[0], forth[1])


def test_noise_differs_from_image_to_image_and_is_small():
    one, other = (look(fixed=WALL, seed=seed).pixels.astype(int) for seed in (1, 2))
    difference = (one - other)[200:280, 280:360]
    assert 2 < (difference - difference.mean()).std() < 9


@pytest.mark.parametrize("x_m", [0.0, 0.1, 0.3, -2.0])
def test_one_at_the_camera_or_behind_it_does_no_harm(x_m):
    view = look(body(x_m, 0.0, heading=0.5, swing=1.0))
    assert np.isfinite(view.corners_px).all()
    if x_m == -2.0:
        assert view.names == ()


def test_an_empty_scene_has_no_boxes():
    view = look()
    assert view.pixels.shape == (480, 640, 3)
    assert view.corners_px.shape == (0, 4)
    assert view.visible.shape == (0,)


coordinates = st.floats(-8, 8)
people = st.lists(st.tuples(coordinates, coordinates, st.floats(-7, 7), st.floats(0, 1)), max_size=12)
ROOM = CameraView(CAMERA, pose(), DOORWAY, np.random.default_rng(3))


@settings(max_examples=25, deadline=None)
@given(people)
def test_boxes_lie_in_the_image_and_shares_between_none_and_all(crowd):
    bodies = [
        body(x, y, heading=heading, phase=heading, swing=swing, name=str(k))
        for k, (x, y, heading, swing) in enumerate(crowd)
    ]
    view = ROOM.render(moment(*bodies), leaf(0.5), np.random.default_rng(1))
    left, top, right, bottom = view.corners_px.T
    assert (left < right).all()
    assert (top < bottom).all()
    assert (view.corners_px >= -0.5).all()
    assert (right <= 639.5).all()
    assert (bottom <= 479.5).all()
    assert ((view.visible >= 0) & (view.visible <= 1)).all()
    assert len(set(view.names)) == len(view.names) == len(view.visible)


def test_surfaces_may_be_missing_altogether():
    assert look(body(3, 0), fixed=NOTHING, leaves=NOTHING).names == ("anna",)


def test_a_body_without_a_place_is_not_drawn():
    view = look(body(np.nan, 0.0), body(3.0, 0.0, name="bob"))
    assert view.names == ("bob",)
    assert np.array_equal(view.corners_px, look(body(3.0, 0.0)).corners_px)
