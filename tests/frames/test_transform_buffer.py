"""The tree of frames over time, against scipy's rotations along the whole chain."""

import math
from itertools import pairwise

import numpy as np
import pytest
from chain_oracle import pose_at, pose_in_root
from hypothesis import assume, given
from hypothesis import strategies as st
from semap_ingest.frames.transform_buffer import Missing, TransformBuffer
from semap_ingest.sensing.transform import Transform

from semap.errors import InvalidInput

SECOND_US = 1_000_000
FIRST_US, LAST_US = 0, 4 * SECOND_US


def turn(yaw_rad: float) -> list[float]:
    return [0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)]


def at(
    stamp_us: int,
    parent: str,
    child: str,
    place: tuple[float, float, float] = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0,
    static: bool = False,
) -> Transform:
    return Transform(stamp_us, parent, child, np.array(place), np.array(turn(yaw_rad)), static)


def filled(*transforms: Transform, keep_us: int = 10 * SECOND_US) -> TransformBuffer:
    buffer = TransformBuffer(keep_us)
    for transform in transforms:
        buffer.add(transform)
    return buffer


@st.composite
def quaternions(draw: st.DrawFn) -> np.ndarray:
    parts = np.array([draw(st.floats(-1, 1)) for _ in range(4)])
    length = np.linalg.norm(parts)
    return parts / length if length > 0.1 else np.array([0.0, 0.0, 0.0, 1.0])


@st.composite
def trees(draw: st.DrawFn) -> tuple[dict[str, list[Transform]], list[Transform]]:
    """Edges by child, each with its transforms in the order of stamps, and all of them in any order."""
    edges: dict[str, list[Transform]] = {}
    for index in range(1, draw(st.integers(2, 7))):
        parent, child = f"frame{draw(st.integers(0, index - 1))}", f"frame{index}"
        is_static = draw(st.booleans())
        inner = draw(st.lists(st.integers(FIRST_US + 1, LAST_US - 1), max_size=3, unique=True))
        stamps = [0] if is_static else sorted([FIRST_US, *inner, LAST_US])
        edges[child] = [
            Transform(
                stamp_us,
                parent,
                child,
                np.array([draw(st.floats(-50, 50)) for _ in range(3)]),
                draw(quaternions()),
                is_static,
            )
            for stamp_us in stamps
        ]
    return edges, draw(st.permutations([each for edge in edges.values() for each in edge]))


@given(trees(), st.integers(FIRST_US, LAST_US), st.data())
def test_any_tree_in_any_order_agrees_with_scipy(tree, stamp_us: int, data: st.DataObject) -> None:
    edges, shuffled = tree
    # of half a turn no way is the shorter one
    assume(all(abs(a.quaternion @ b.quaternion) > 1e-6 for edge in edges.values() for a, b in pairwise(edge)))
    buffer = filled(*shuffled)
    names = st.sampled_from(["frame0", *edges])
    parent, child = data.draw(names), data.draw(names)
    found = buffer.lookup(parent, child, stamp_us)
    expected = np.linalg.inv(pose_in_root(edges, parent, stamp_us)) @ pose_in_root(edges, child, stamp_us)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)


@given(st.lists(st.tuples(st.integers(0, 60), st.floats(-5, 5)), min_size=1, max_size=25), st.integers(0, 20))
def test_what_is_kept_does_not_depend_on_the_order(told: list[tuple[int, float]], keep_us: int) -> None:
    newest = dict(told)  # of one stamp the last said holds
    in_order = filled(
        *(at(stamp, "a", "b", (newest[stamp], 0, 0)) for stamp in sorted(newest)), keep_us=keep_us
    )
    as_told = filled(*(at(stamp, "a", "b", (place, 0, 0)) for stamp, place in told), keep_us=keep_us)
    horizon = max(newest) - keep_us
    kept = [
        stamp for stamp in newest if stamp >= max((s for s in newest if s <= horizon), default=min(newest))
    ]
    for stamp in range(-1, 62):
        found, same = as_told.lookup("a", "b", stamp), in_order.lookup("a", "b", stamp)
        np.testing.assert_array_equal(found, same)
        if stamp < min(kept):
            assert found is Missing.TOO_EARLY
        elif stamp > max(kept):
            assert found is Missing.NOT_YET
        else:
            assert isinstance(found, np.ndarray)


def test_interpolation_turns_the_shorter_way_at_a_constant_rate() -> None:
    buffer = filled(at(0, "odom", "base", (0, 0, 0), -3.0), at(10, "odom", "base", (10, -20, 5), 3.0))
    for stamp_us in range(11):
        found = buffer.lookup("odom", "base", stamp_us)
        yaw_rad = -3.0 - stamp_us / 10 * (2 * math.pi - 6.0)
        np.testing.assert_allclose(found[:2, 0], [math.cos(yaw_rad), math.sin(yaw_rad)], atol=1e-12)
        np.testing.assert_allclose(found[:3, 3], [stamp_us, -2 * stamp_us, stamp_us / 2], atol=1e-12)


def test_turns_that_hardly_differ() -> None:
    buffer = filled(at(0, "a", "b", yaw_rad=1.0), at(1000, "a", "b", yaw_rad=1.0 + 1e-9))
    yaw_rad = math.atan2(*buffer.lookup("a", "b", 500)[1::-1, 0])
    assert yaw_rad == pytest.approx(1.0 + 5e-10, abs=1e-15)


def test_a_quaternion_and_its_negative_are_one_turn() -> None:
    start = at(0, "a", "b", yaw_rad=0.5)
    end = Transform(10, "a", "b", start.translation_m, -start.quaternion)
    np.testing.assert_allclose(filled(start, end).lookup("a", "b", 5), pose_at([start], 0), atol=1e-15)


def test_nothing_is_extrapolated() -> None:
    buffer = filled(at(100, "map", "base"), at(200, "map", "base"))
    assert buffer.lookup("map", "base", 99) is Missing.TOO_EARLY
    assert buffer.lookup("base", "map", 99) is Missing.TOO_EARLY
    assert buffer.lookup("map", "base", 201) is Missing.NOT_YET
    assert isinstance(buffer.lookup("map", "base", 100), np.ndarray)
    assert isinstance(buffer.lookup("map", "base", 200), np.ndarray)


def test_where_both_ends_lack_it_is_too_early() -> None:
    buffer = filled(at(100, "map", "a"), at(10, "map", "b"))
    for parent, child in [("a", "b"), ("b", "a")]:
        assert buffer.lookup(parent, child, 50) is Missing.TOO_EARLY
    buffer = filled(at(100, "map", "a"), at(10, "a", "b"), at(100, "b", "c"))
    assert buffer.lookup("map", "c", 50) is Missing.TOO_EARLY


def test_an_edge_above_the_common_ancestor_is_not_asked() -> None:
    buffer = filled(
        at(0, "map", "base"),
        at(0, "base", "laser", (1, 0, 0), static=True),
        at(0, "base", "camera", static=True),
    )
    assert buffer.lookup("camera", "laser", 5 * SECOND_US)[0, 3] == 1


def test_frames_that_nobody_named_and_frames_apart() -> None:
    buffer = filled(at(0, "map", "base"), at(0, "world", "arm"))
    assert buffer.lookup("map", "laser", 0) is Missing.UNKNOWN_FRAME
    assert buffer.lookup("laser", "map", 0) is Missing.UNKNOWN_FRAME
    assert buffer.lookup("map", "arm", 0) is Missing.NOT_CONNECTED
    np.testing.assert_array_equal(buffer.lookup("nowhere", "nowhere", 0), np.eye(4))


def test_a_chain_that_was_missing_is_found_once_it_is_told() -> None:
    buffer = filled(at(0, "map", "odom"), at(0, "base", "laser"))
    assert buffer.lookup("map", "laser", 0) is Missing.NOT_CONNECTED
    buffer.add(at(0, "odom", "base", (3, 0, 0)))
    assert buffer.lookup("map", "laser", 0)[0, 3] == 3


def test_a_frame_put_elsewhere() -> None:
    """A box on the table, later in the gripper; between the two it stays where it was."""
    buffer = filled(
        at(0, "map", "table", (1, 0, 0), static=True),
        at(0, "map", "gripper", (0, 5, 0), static=True),
        at(0, "table", "box", (0.1, 0, 0)),
        at(10, "table", "box", (0.2, 0, 0)),
        at(20, "gripper", "box", (0, 0, 0.3)),
        at(30, "gripper", "box", (0, 0, 0.5)),
    )
    told = {
        stamp: tuple(np.round(buffer.lookup("map", "box", stamp)[:3, 3], 9)) for stamp in (5, 10, 15, 20, 25)
    }
    assert told == {5: (1.15, 0, 0), 10: (1.2, 0, 0), 15: (1.2, 0, 0), 20: (0, 5, 0.3), 25: (0, 5, 0.4)}
    assert buffer.lookup("table", "box", 25)[1, 3] == 5


def test_a_frame_put_elsewhere_forgets_its_old_parent_in_time() -> None:
    buffer = filled(
        at(0, "a", "box"), at(100, "b", "box", (1, 0, 0)), at(150, "b", "box", (1, 0, 0)), keep_us=10
    )
    assert buffer.lookup("a", "box", 150) is Missing.NOT_CONNECTED
    assert buffer.lookup("b", "box", 150)[0, 3] == 1
    assert buffer.lookup("b", "box", 0) is Missing.TOO_EARLY


def test_of_two_with_one_stamp_the_later_said_holds() -> None:
    buffer = filled(at(5, "map", "base", (1, 0, 0)), at(5, "map", "base", (2, 0, 0)))
    assert buffer.lookup("map", "base", 5)[0, 3] == 2
    buffer.add(at(5, "odom", "base", (3, 0, 0)))
    assert buffer.lookup("map", "base", 5) is Missing.NOT_CONNECTED
    assert buffer.lookup("odom", "base", 5)[0, 3] == 3


def test_a_static_transform_holds_whatever_else_is_said() -> None:
    static, stamped = at(7, "base", "laser", (1, 0, 0), static=True), at(7, "base", "laser", (2, 0, 0))
    for order in [(static, stamped), (stamped, static)]:
        buffer = filled(*order)
        for stamp_us in (-(10**15), 7, 10**15):
            assert buffer.lookup("base", "laser", stamp_us)[0, 3] == 1
    assert buffer.add(stamped) is False
    assert buffer.add(at(0, "base", "laser", (4, 0, 0), static=True)) is True
    assert buffer.lookup("base", "laser", 7)[0, 3] == 4


def test_frames_in_a_circle_end() -> None:
    buffer = filled(at(0, "a", "b", (1, 0, 0)), at(0, "b", "c"), at(0, "c", "a"), at(0, "map", "odom"))
    assert isinstance(buffer.lookup("a", "b", 0), np.ndarray)
    assert buffer.lookup("map", "a", 0) is Missing.NOT_CONNECTED


def test_memory_is_bounded_and_too_old_ones_are_told() -> None:
    buffer = TransformBuffer(keep_us=100)
    assert all(buffer.add(at(stamp_us, "map", "base")) for stamp_us in range(0, 10_000, 10))
    assert buffer.add(at(9_889, "map", "base")) is False
    assert buffer.add(at(9_891, "map", "base", (9, 0, 0))) is True
    assert buffer.lookup("map", "base", 9_891)[0, 3] == 9
    assert buffer.lookup("map", "base", 9_889) is Missing.TOO_EARLY
    assert isinstance(buffer.lookup("map", "base", 9_890), np.ndarray)


def test_the_caller_cannot_change_what_is_kept() -> None:
    buffer = filled(at(0, "base", "laser", static=True))
    with pytest.raises(ValueError, match="read-only"):
        buffer.lookup("base", "laser", 0)[0, 3] = 1


@pytest.mark.parametrize(
    "transform",
    [
        at(0, "base", "base"),
        at(0, "", "base"),
        at(0, "base", ""),
        at(0, "map", "base", (math.nan, 0, 0)),
        at(0, "map", "base", (math.inf, 0, -math.inf)),
        Transform(0, "map", "base", np.zeros(3), np.zeros(4)),
        Transform(0, "map", "base", np.zeros(3), np.full(4, math.nan)),
    ],
)
def test_a_pose_that_is_none_is_refused_and_leaves_nothing(transform: Transform) -> None:
    buffer = TransformBuffer()
    with pytest.raises(InvalidInput, match="transform from"):
        buffer.add(transform)
    assert buffer.lookup("map", "base", 0) is Missing.UNKNOWN_FRAME
