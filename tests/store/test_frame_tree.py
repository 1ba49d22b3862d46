"""Frames: where one stood in another, now and then; SciPy's rotations are the oracle."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from sqlalchemy import Connection, Engine

from semap.errors import Conflict, InvalidInput, NotFound
from semap.model.pose import Pose
from semap.store.map import frames
from semap.store.map.instance_edit import Changes, delete_instance, edit_instance
from semap.store.map.instances import list_instances
from semap.store.map.maps import create_map

START = datetime(2026, 1, 31, 12, tzinfo=UTC)
NAIVE = START.replace(tzinfo=None)


@pytest.fixture
def connection(engine: Engine):
    with engine.begin() as connection:
        create_map(connection, "office")
        yield connection


def turned(x_m: float, y_m: float, z_m: float, *angles: float) -> Pose:
    return Pose(x_m, y_m, z_m, *(float(part) for part in Rotation.from_euler("xyz", angles).as_quat()))


def near(pose: Pose, matrix: np.ndarray) -> bool:
    return bool(np.allclose(pose.matrix(), matrix, atol=1e-12))


def test_a_transform_between_any_two_frames(connection: Connection) -> None:
    a_pose, b_pose, c_pose = (
        turned(1, 2, 3, 0.3, -1, 2),
        turned(-4, 0, 1, 0, 0.5, 0.1),
        turned(0, 7, 0, 3, 1, -2),
    )
    a = frames.create_frame(connection, "office", "a", "map", a_pose)
    b = frames.create_frame(connection, "office", "b", "a", b_pose)
    c = frames.create_frame(connection, "office", "c", "map", c_pose)
    expected = np.linalg.inv(c_pose.matrix()) @ a_pose.matrix() @ b_pose.matrix()
    assert near(frames.transform(connection, c.frame_id, b.frame_id), expected)
    assert near(frames.transform(connection, b.frame_id, c.frame_id), np.linalg.inv(expected))
    assert near(frames.transform(connection, a.frame_id, a.frame_id), np.eye(4))
    assert frames.list_frames(connection, "office")[2] == b


def test_where_it_was_between_two_stamps(connection: Connection) -> None:
    moving = frames.create_frame(connection, "office", "robot", "map")
    root = frames.frame_named(connection, "office", "map")
    first, last = turned(0, 0, 0, 0.1, 0.2, -3), turned(4, 2, -1, 2, -1, 1)
    frames.set_pose(connection, moving.frame_id, first, START)
    frames.set_pose(connection, moving.frame_id, last, START + timedelta(seconds=8))
    slerp = Slerp([0, 1], Rotation.from_quat([[p.qx, p.qy, p.qz, p.qw] for p in (first, last)]))
    for part in (0, 0.125, 0.5, 0.9, 1):
        at = START + timedelta(seconds=8 * part)
        expected = np.eye(4)
        expected[:3, :3] = slerp([part]).as_matrix()[0]
        expected[:3, 3] = [4 * part, 2 * part, -part]
        assert near(frames.transform(connection, root.frame_id, moving.frame_id, at), expected)
    after = frames.transform(connection, root.frame_id, moving.frame_id, START + timedelta(days=1))
    assert near(after, last.matrix())
    assert near(frames.transform(connection, root.frame_id, moving.frame_id), last.matrix())
    before = frames.transform(connection, root.frame_id, moving.frame_id, START - timedelta(days=1))
    assert near(before, np.eye(4))
    assert not frames.get_frame(connection, moving.frame_id).is_static
    assert [stamp for stamp, _ in frames.list_poses(connection, moving.frame_id)] == [
        None, START, START + timedelta(seconds=8)
    ]  # fmt: skip


def test_a_frame_that_keeps_the_world_keeps_it_at_each_stamp(connection: Connection) -> None:
    root = frames.frame_named(connection, "office", "map").frame_id
    table = frames.create_frame(connection, "office", "table", "map", turned(5, 5, 0, 0, 0, 1))
    cup = frames.create_frame(connection, "office", "cup", "map", turned(1, 1, 1, 0, 0, 0.2)).frame_id
    stamps = [START + timedelta(seconds=second) for second in (0, 3)]
    frames.set_pose(connection, cup, turned(2, 3, 4, 1, 2, 3), stamps[0])
    frames.set_pose(connection, cup, turned(3, 1, 0, 0, 2, 3), stamps[1])
    before = [frames.transform(connection, root, cup, at) for at in (*stamps, None)]
    assert frames.change_frame(connection, cup, "table").parent == "table"
    for at, pose in zip((*stamps, None), before, strict=True):
        assert near(frames.transform(connection, root, cup, at), pose.matrix())
    frames.set_pose(connection, table.frame_id, turned(6, 5, 0, 0, 0, 1))
    assert frames.transform(connection, root, cup).x_m == pytest.approx(before[-1].x_m + 1)
    moved = frames.change_frame(connection, cup, "map", keep="local")
    assert moved.parent == "map"


def test_what_cannot_be_is_refused(connection: Connection) -> None:
    a = frames.create_frame(connection, "office", "a", "map")
    b = frames.create_frame(connection, "office", "b", "a")
    island = frames.create_frame(connection, "office", "island", None)
    root = frames.frame_named(connection, "office", "map")
    nowhere = connection.exec_driver_sql(
        "insert into semap.frame (map_id, name, parent_id) select map_id, 'new', %s from semap.map returning frame_id",
        (root.frame_id,),
    ).scalar_one()
    frames.set_pose(connection, nowhere, Pose(), START)
    create_map(connection, "other")
    for act, error, match in (
        (lambda: frames.change_frame(connection, a.frame_id, "b"), InvalidInput, "stands on it"),
        (lambda: frames.change_frame(connection, a.frame_id, "a"), InvalidInput, "stands on it"),
        (lambda: frames.change_frame(connection, root.frame_id, "a"), Conflict, "root frame"),
        (lambda: frames.delete_frame(connection, a.frame_id), Conflict, "carries other things: b"),
        (lambda: frames.create_frame(connection, "office", "a"), Conflict, "a"),
        (lambda: frames.create_frame(connection, "office", "c", "nothing"), NotFound, "nothing"),
        (
            lambda: frames.set_pose(connection, b.frame_id, Pose(), NAIVE),
            InvalidInput,
            "time zone",
        ),
        (lambda: frames.set_pose(connection, b.frame_id, Pose(qw=0)), InvalidInput, "quaternion"),
        (lambda: frames.transform(connection, island.frame_id, b.frame_id), InvalidInput, "different trees"),
        (lambda: frames.transform(connection, a.frame_id, 10**9), NotFound, "no frame 1000000000"),
        (
            lambda: frames.transform(connection, a.frame_id, nowhere, START - timedelta(seconds=1)),
            InvalidInput,
            "no pose yet",
        ),
    ):
        with pytest.raises(error, match=match), connection.begin_nested():
            act()
    foreign = frames.frame_named(connection, "other", "map").frame_id
    with pytest.raises(Exception, match="another map"), connection.begin_nested():
        connection.exec_driver_sql(
            "update semap.frame set parent_id = %s where frame_id = %s", (foreign, a.frame_id)
        )
    frames.delete_frame(connection, b.frame_id)
    assert frames.rename_frame(connection, a.frame_id, "c").name == "c"


def test_the_world_that_is_kept_is_the_present_one(connection: Connection) -> None:
    """The cup was last seen before the cart drove away: it stands where it is, not where the cart was then."""
    root = frames.frame_named(connection, "office", "map").frame_id
    cup = frames.create_frame(connection, "office", "cup", "map").frame_id
    cart = frames.create_frame(connection, "office", "cart", "map").frame_id
    frames.set_pose(connection, cup, turned(10, 0, 0, 0, 0, 1), START)
    frames.set_pose(connection, cart, turned(100, 5, 0, 0, 0, 2), START + timedelta(hours=1))
    frames.change_frame(connection, cup, "cart")
    assert near(frames.transform(connection, root, cup), turned(10, 0, 0, 0, 0, 1).matrix())
    with pytest.raises(Conflict, match="stamped poses"), connection.begin_nested():
        frames.set_pose(connection, cup, Pose())
    with pytest.raises(Conflict, match="root frame"), connection.begin_nested():
        frames.set_pose(connection, root, Pose(x_m=1))


def test_what_stands_on_the_root_takes_nothing_with_it(connection: Connection) -> None:
    frames.create_frame(connection, "office", "desk", "map", Pose(x_m=1))
    site, desk = (
        connection.exec_driver_sql(
            "insert into semap.instance (map_id, name, concept_id, frame_id)"
            " select f.map_id, %s, c.concept_id, f.frame_id from semap.frame f, semap.concept c"
            " where f.name = %s and c.name = 'Space' returning instance_id",
            (name, frame),
        ).scalar_one()
        for name, frame in (("site", "map"), ("desk", "desk"))
    )
    with pytest.raises(Conflict, match="root"), connection.begin_nested():
        edit_instance(connection, site, Changes(pose=Pose(x_m=7)))
    delete_instance(connection, site, "delete")
    assert [each.instance_id for each in list_instances(connection)] == [desk]
    assert frames.frame_named(connection, "office", "desk").parent == "map"
