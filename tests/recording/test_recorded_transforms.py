"""Transforms in real bags: those that come late are waited for, and a place that is told otherwise counts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from bags import FORMATS, Ros, Said, write
from perceived import perceived
from semap_ingest.pipeline.rig import read_rig

from semap.errors import InvalidInput

START_NS = 1_785_000_000 * 10**9
SECOND_NS, TENTH_NS = 10**9, 10**8
TF, PEOPLE, SCAN = "tf2_msgs/msg/TFMessage", "people_msgs/msg/People", "sensor_msgs/msg/LaserScan"
SPEED_MPS = 0.5
BEAMS, STEP_RAD = 181, float(np.deg2rad(0.5))
WALL_M = 2.0 / np.cos(-0.5 + STEP_RAD * np.arange(BEAMS))


def localised(ros: Ros, every_s: float, seconds: float, drift_mps: float = 0.0) -> list[Said]:
    """map to odom seldom, and odom to the robot, which drives along x, at 20 Hz."""
    said = []
    for time_s in np.arange(0.0, seconds + every_s, every_s):
        stamp = START_NS + round(time_s * SECOND_NS)
        said.append(
            Said(
                "/tf", TF, ros.tf(ros.transform(stamp, "map", "odom", (1 + drift_mps * time_s, 0, 0))), stamp
            )
        )
    for time_s in np.arange(0.0, seconds + every_s, 0.05):
        stamp = START_NS + round(time_s * SECOND_NS)
        place = (SPEED_MPS * time_s, 0, 0.3)
        said.append(Said("/tf", TF, ros.tf(ros.transform(stamp, "odom", "laser", place)), stamp))
    return said


def scans(ros: Ros, seconds: float) -> list[Said]:
    """A wall that stands 2 m before the laser, whatever it does."""
    stamps = [START_NS + n * TENTH_NS for n in range(1, int(seconds * 10))]
    return [Said("/scan", SCAN, ros.scan(stamp, WALL_M, step=STEP_RAD), stamp) for stamp in stamps]


def people(ros: Ros, seconds: float) -> list[Said]:
    """Somebody who stands in the map, told without delay."""
    said = []
    for n in range(1, int(seconds * 10)):
        stamp = START_NS + n * TENTH_NS + 3
        message = ros.people(stamp, {"ann": (5.0, 5.0, 0.0)})
        said.append(Said("/people", PEOPLE, message, stamp))
    return said


def recorded(folder: Path, kind: str, ros: Ros, *said: Sequence[Said]) -> Path:
    return write(
        folder, kind, sorted((one for each in said for one in each), key=lambda each: each.log_ns), ros
    )


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("every_s", [1.0, 15.0])
def test_a_localisation_that_speaks_seldom_costs_no_scan(tmp_path: Path, kind: str, every_s: float) -> None:
    """15 s is more than transforms are kept live, and more than a thousand records wait."""
    ros = Ros(is_ros1=kind == "ros1")
    seconds = 2 * every_s
    path = recorded(tmp_path, kind, ros, localised(ros, every_s, seconds, 0.01), scans(ros, seconds))
    found, perception = perceived(path)
    lines = [each for one in found for each in one.lines]
    assert (dict(perception.left_out), perception.given_up) == ({}, 0)
    assert len(lines) == int(seconds * 10) - 1
    for each in lines:
        time_s = each.lines.stamp_us / 1e6 - START_NS / 1e9
        wall_m = 1 + 0.01 * time_s + SPEED_MPS * time_s + 2.0
        np.testing.assert_allclose(each.lines.ends_m[..., 0], wall_m, atol=0.02)


def test_what_needs_no_transform_waits_with_what_does(tmp_path: Path) -> None:
    """So that nothing of either comes too late for the other."""
    ros = Ros(is_ros1=False)
    path = recorded(tmp_path, "mcap", ros, localised(ros, 4.0, 8.0), scans(ros, 8.0), people(ros, 8.0))
    found, perception = perceived(path, topics={"poses": ["/people"]})
    assert dict(perception.left_out) == {}
    stamps = [each.states.stamp_us for one in found for each in one.persons]
    assert stamps == sorted(stamps)
    assert sum(len(one.lines) for one in found) == 79


def test_a_patience_that_is_given_is_kept(tmp_path: Path) -> None:
    ros = Ros(is_ros1=False)
    path = recorded(tmp_path, "mcap", ros, localised(ros, 2.0, 4.0), scans(ros, 4.0))
    found, perception = perceived(path, transform_patience_s=0.5)
    assert 10 <= perception.given_up < 39
    assert sum(len(one.lines) for one in found) == 39 - perception.given_up


def test_what_always_holds_holds_before_it_was_recorded(tmp_path: Path) -> None:
    """As where recording began before the publisher of /tf_static was seen; a later one holds from then on."""
    ros = Ros(is_ros1=False)
    placed = [
        Said("/tf_static", TF, ros.tf(ros.transform(START_NS, "map", "laser", (x_m, 0, 0.3))), START_NS + at)
        for x_m, at in ((1.0, 3 * SECOND_NS), (2.0, 4 * SECOND_NS))
    ]
    found, perception = perceived(recorded(tmp_path, "mcap", ros, scans(ros, 6.0), placed))
    assert dict(perception.left_out) == {}
    lines = [each for one in found for each in one.lines]
    walls = {each.lines.stamp_us - START_NS // 1000: each.lines.ends_m[0, 0, 0] for each in lines}
    assert len(walls) == 59
    for after_us, wall_m in walls.items():
        assert wall_m == pytest.approx(3.0 if after_us <= 4_000_000 else 4.0, abs=0.02)


@pytest.mark.parametrize("kind", FORMATS)
def test_the_sweep_of_a_robot_that_turns_is_straightened_by_tf(tmp_path: Path, kind: str) -> None:
    """At 1 rad/s a sweep of 0.1 s ends 6 degrees off: a wall would be bent, and 0.2 m off at its far end."""
    ros = Ros(is_ros1=kind == "ros1")
    beams, step, rate = 361, float(np.deg2rad(0.5)), 1.0
    beam_s = 0.1 / (beams - 1)
    turns = [
        Said("/tf", TF, ros.tf(ros.transform(stamp, "map", "laser", (0, 0, 0.3), yaw(rate * (stamp - START_NS) / 1e9))), stamp)
        for stamp in range(START_NS, START_NS + 2 * SECOND_NS, SECOND_NS // 50)
    ]  # fmt: skip
    seen = []
    for n in range(1, 18):
        stamp = START_NS + n * TENTH_NS
        angles = -np.pi / 2 + step * np.arange(beams)
        turned = angles + rate * (n * 0.1 + beam_s * np.arange(beams))
        ranges = 2.0 / np.cos(turned)  # to a wall at x = 2 m of the map
        message = ros.scan(stamp, np.where((ranges > 0) & (ranges < 6), ranges, np.inf), step=step)
        message.angle_min, message.time_increment = -np.pi / 2, beam_s
        seen.append(Said("/scan", SCAN, message, stamp))
    found, perception = perceived(recorded(tmp_path, kind, ros, turns, seen))
    assert dict(perception.left_out) == {}
    lines = [each.lines for one in found for each in one.lines]
    assert len(lines) == 17
    ends_m = np.concatenate([each.ends_m.reshape(-1, 2) for each in lines])
    assert np.abs(ends_m[:, 0] - 2.0).max() < 0.01
    assert max(len(each.ends_m) for each in lines) == 1


def yaw(angle_rad: float) -> tuple[float, float, float, float]:
    return 0.0, 0.0, float(np.sin(angle_rad / 2)), float(np.cos(angle_rad / 2))


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("type_name", ["PoseWithCovarianceStamped", "PoseStamped"])
def test_a_pose_in_the_map_places_a_robot_whose_tf_ends_at_odom(
    tmp_path: Path, kind: str, type_name: str
) -> None:
    """The odometry's origin is at (3, 4) in the map, turned by a quarter; a pose comes every 2 s, the last at 4 s."""
    ros = Ros(is_ros1=kind == "ros1")
    tf = [
        Said("/tf", TF, ros.tf(ros.transform(stamp, "odom", "base_link", (SPEED_MPS * (stamp - START_NS) / 1e9, 0, 0))), stamp)
        for stamp in range(START_NS, START_NS + 7 * SECOND_NS, SECOND_NS // 20)
    ]  # fmt: skip
    tf.append(
        Said("/tf_static", TF, ros.tf(ros.transform(START_NS, "base_link", "laser", (0, 0, 0.3))), START_NS)
    )
    poses = []
    for time_s in (0.0, 2.0, 4.0):
        stamp = START_NS + round(time_s * SECOND_NS) + 1_000_000
        pose = ros.pose((3, 4 + SPEED_MPS * (time_s + 0.001), 0), yaw(np.pi / 2))
        if type_name == "PoseWithCovarianceStamped":
            pose = ros.make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.zeros(36))
        message = ros.make(f"geometry_msgs/{type_name}", header=ros.header(stamp, "map"), pose=pose)
        poses.append(Said("/amcl_pose", f"geometry_msgs/msg/{type_name}", message, stamp))
    path = recorded(tmp_path, kind, ros, tf, poses, scans(ros, 6.0))
    file = tmp_path / "rig.yaml"
    file.write_text("sensors: {l: {kind: laser, topic: /scan}}\nlocalisation: {topic: /amcl_pose}\n")
    found, perception = perceived(path, rig=read_rig(file))
    assert dict(perception.left_out) == {}
    lines = [each.lines for one in found for each in one.lines]
    assert len(lines) == 59
    for each in lines:
        time_s = each.stamp_us / 1e6 - START_NS / 1e9
        np.testing.assert_allclose(each.ends_m[..., 1], 4 + SPEED_MPS * time_s + 2.0, atol=0.02)


CLOUD = "sensor_msgs/msg/PointCloud2"


def clouds(ros: Ros) -> list[Said]:
    """A wall 2 m ahead from the floor up, and a lamp that hangs nearer, in the frame of a sensor 1.5 m high."""
    across, up = (
        axis.ravel() for axis in np.meshgrid(np.arange(-1.5, 1.5, 0.01), np.arange(-1.5, 1.0, 0.05))
    )
    wall = np.column_stack([np.full(len(across), 2.0), across, up])
    lamp = np.column_stack([np.full(50, 1.0), np.linspace(-0.3, 0.3, 50), np.full(50, 0.5)])
    points = np.concatenate([wall, lamp]).astype(np.float32)
    told = np.array([tuple(point) for point in points], np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4")]))
    stamps = [START_NS + n * TENTH_NS for n in range(10)]
    return [
        Said("/tf_static", TF, ros.tf(ros.transform(START_NS, "map", "velodyne", (1, 1, 1.5))), START_NS),
        *(Said("/points", CLOUD, ros.cloud(stamp, told), stamp) for stamp in stamps),
    ]


@pytest.mark.parametrize("kind", FORMATS)
def test_a_slice_of_a_cloud_is_a_scan_where_that_is_asked_for(tmp_path: Path, kind: str) -> None:
    ros = Ros(is_ros1=kind == "ros1")
    path = write(tmp_path, kind, clouds(ros), ros)
    file = tmp_path / "rig.yaml"
    file.write_text("sensors: {l: {kind: laser, topic: /points, slice_m: [-1.3, -1.0]}}")
    found, perception = perceived(path, rig=read_rig(file))
    assert dict(perception.left_out) == {}
    lines = [each.lines for one in found for each in one.lines]
    assert len(lines) == 10
    ends_m = np.concatenate([each.ends_m for each in lines])
    np.testing.assert_allclose(ends_m[..., 0], 3.0, atol=0.01)
    assert np.ptp(ends_m[..., 1], axis=1).min() > 2.8
    assert len(ends_m) == 10


def test_a_cloud_that_nobody_asked_for_is_named_with_what_helps(tmp_path: Path) -> None:
    ros = Ros(is_ros1=False)
    path = write(tmp_path, "mcap", clouds(ros), ros)
    with pytest.raises(InvalidInput, match="neither scans nor images") as caught:
        perceived(path)
    assert "{kind: laser, topic: /points, slice_m: [LOW, HIGH]}" in caught.value.remedy
    file = tmp_path / "rig.yaml"
    file.write_text("sensors: {l: {kind: laser, topic: /points}}")
    with pytest.raises(InvalidInput, match="of the type sensor_msgs/msg/PointCloud2") as caught:
        perceived(path, rig=read_rig(file))
    assert "slice_m" in caught.value.remedy
    file.write_text("sensors: {l: {kind: laser, topic: /points, slice_m: [1, 0]}}")
    with pytest.raises(InvalidInput, match="the lower one comes first"):
        read_rig(file)
