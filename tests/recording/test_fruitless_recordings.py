"""Recordings of which nothing, or not all that was meant, can come: refused, or told with the true reason."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from bags import Ros, Said, write
from semap_ingest.pipeline.ingest_recording import Plan, ingest_recording
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.sensor import Sensor
from semap_ingest.pipeline.topics import cast_parts
from semap_ingest.recording.reading import Received, Recording
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import Camera
from semap_ingest.sensing.transform import Transform
from semap_service.cli import commands
from typer.testing import CliRunner
from world import World

from semap.errors import InvalidInput

START_NS = 1_785_000_000 * 10**9
TENTH_NS = 10**8
BEAMS = 181
LOOKS_AHEAD = np.array([-0.5, 0.5, -0.5, 0.5])
STEP_RAD = float(np.deg2rad(0.5))
WALL_M = 2.0 / np.cos(-0.5 + STEP_RAD * np.arange(BEAMS))
ROS = Ros(is_ros1=False)
SCAN, TF, IMAGE, PACKED = (
    "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage",
)  # fmt: skip
STILL = Said("/tf_static", TF, ROS.tf(ROS.transform(START_NS, "map", "laser", (1, 1, 0.3))), START_NS)


def scans(ranges: Sequence[float] = WALL_M, frame: str = "laser", **more: float) -> list[Said]:
    said = []
    for number in range(8):
        stamp_ns = START_NS + number * TENTH_NS
        message = ROS.scan(stamp_ns, ranges, frame, STEP_RAD)
        for name, value in more.items():
            setattr(message, name, value)
        said.append(Said("/scan", SCAN, message, stamp_ns))
    return said


def recorded(folder: Path, said: Sequence[Said]) -> Plan:
    ordered = sorted(said, key=lambda each: each.log_ns)
    return Plan("world", "robot", write(folder, "mcap", ordered, ROS))


def test_a_wall_is_found(world: World, tmp_path: Path) -> None:
    done = ingest_recording(world.dsn, recorded(tmp_path, [STILL, *scans()]))
    assert done.lines == 8
    assert (done.fruitless, done.left_out) == ((), {})


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"angle_increment": 0.0}, "181 beams in steps of 0 rad do not make one sweep"),
        ({"angle_increment": 0.5}, "181 beams in steps of 0.5 rad do not make one sweep"),
        ({"range_max": 0.0}, "in which nothing lies"),
        ({"range_max": float("nan")}, "in which nothing lies"),
        ({"range_min": 9.0}, "in which nothing lies"),
    ],
)
def test_scans_that_are_none_are_refused(
    world: World, tmp_path: Path, wrong: dict[str, float], says: str
) -> None:
    with pytest.raises(InvalidInput, match="neither scans nor images") as caught:
        ingest_recording(world.dsn, recorded(tmp_path, [STILL, *scans(**wrong)]))
    assert says in caught.value.remedy
    assert world.one("select count(*) from semap.source where name like 'robot%%'") == 0


def test_scans_in_which_nothing_came_back_are_an_exit_status(world: World, tmp_path: Path) -> None:
    plan = recorded(tmp_path, [STILL, *scans([float("nan")] * BEAMS)])
    asked = ["ingest", "recording", str(plan.path), "--map", "world", "--dsn", world.dsn]
    ran = CliRunner().invoke(commands(), asked)
    assert ran.exit_code == 1
    assert "left out: 8 records: /scan: nothing came back in it" in ran.output
    assert "none of 8 records of /scan could be used" in ran.output
    assert "no person and no line was found" in ran.output


TURNING = [
    Said("/tf", TF, ROS.tf(ROS.transform(stamp, "odom", "laser", (1, 1, 0.3))), stamp)
    for stamp in range(START_NS - TENTH_NS, START_NS + 9 * TENTH_NS, TENTH_NS // 2)
]
ONCE = Said("/tf", TF, ROS.tf(ROS.transform(START_NS - 10**9, "map", "odom")), START_NS - 10**9)
OTHER = Said("/tf_static", TF, ROS.tf(ROS.transform(START_NS, "map", "door")), START_NS)


@pytest.mark.parametrize(
    ("said", "says"),
    [
        ([ONCE, *TURNING, *scans()], "the transform from 'map' to 'odom' was sent once, for 2026-07-25T17:19:59+00:00,"),
        ([STILL, *scans(frame="")], "/scan: its messages name no frame"),
        (scans(), "no transform names the frame 'laser'"),
        ([OTHER, *TURNING, *scans()], "transforms lead from 'laser' up to 'odom', and from 'map' up to 'map'"),
        ([STILL, *scans(frame="base_laser")], "no transform names the frame 'base_laser'"),
    ],
)  # fmt: skip
def test_why_it_is_not_known_where_the_sensors_stood(
    world: World, tmp_path: Path, said: list[Said], says: str
) -> None:
    with pytest.raises(
        InvalidInput, match="it is not known where its sensors stood in the frame 'map'"
    ) as caught:
        ingest_recording(world.dsn, recorded(tmp_path, said))
    assert says in str(caught.value)
    assert world.one("select count(*) from semap.source where name like 'robot%%'") == 0


def images(topic: str, messages: Sequence[object], kind: str) -> list[Said]:
    return [Said(topic, kind, each, START_NS + n * TENTH_NS) for n, each in enumerate(messages)]


COLOUR = ROS.image(START_NS, "rgb8", 1, 2, 6, bytes(6))
DEPTH = ROS.image(START_NS, "16UC1", 1, 2, 4, bytes(4))
FLOATS = ROS.image(START_NS, "32FC1", 1, 2, 8, bytes(8))
EMPTY = ROS.image(START_NS, "rgb8", 0, 0, 0, b"")
PACKED_DEPTHS = [
    ROS.compressed(START_NS, b"x" * 20, kind)
    for kind in ("16UC1; compressedDepth png", "16UC1; png compressed ", "32FC1; compressedDepth", "32FC1")
]


@pytest.mark.parametrize(
    "beside",
    [
        *([Said("/depth/image/compressed", PACKED, each, START_NS)] for each in PACKED_DEPTHS),
        images("/depth/image_raw", [DEPTH, DEPTH], IMAGE),
        images("/depth/image_raw", [FLOATS], IMAGE),
        images("/other/image_raw", [EMPTY], IMAGE),
    ],
)
def test_images_of_depth_do_not_replace_the_colour_camera(tmp_path: Path, beside: list[Said]) -> None:
    said = [*images("/camera/image_raw", [COLOUR] * 3, IMAGE), *beside]
    with Recording(write(tmp_path, "mcap", said, ROS)) as recording:
        parts = cast_parts(recording.topics, {}, flaw_of=recording.flaw_of)
    assert parts.topics["image"] == ("/camera/image_raw",)
    assert list(parts.useless) == [beside[0].topic]


def test_packed_images_of_another_camera_are_a_question_to_the_user(tmp_path: Path) -> None:
    jpeg = ROS.compressed(START_NS, b"\xff\xd8 no more", "jpeg")
    said = [
        *images("/camera/image_raw", [COLOUR], IMAGE),
        *images("/infra/image_raw/compressed", [jpeg], PACKED),
    ]
    with (
        Recording(write(tmp_path, "mcap", said, ROS)) as recording,
        pytest.raises(InvalidInput, match="several topics could be the image"),
    ):
        cast_parts(recording.topics, {}, flaw_of=recording.flaw_of)


START_US = START_NS // 1000
LENS = Camera("camera_link", 640, 480, np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.zeros(0))


def played(*, is_one_camera: bool) -> Perception:
    perception = Perception(
        [Sensor("eye", "camera", "/boxes", info_topic="/camera_info" if is_one_camera else None)]
    )
    stands = Transform(START_US, "map", "optical", np.array([0.0, 0, 1.2]), LOOKS_AHEAD, is_static=True)
    perception.take(Received(START_US, "/tf_static", stands))
    perception.take(Received(START_US, "/camera_info", LENS))
    for number in range(20):
        stamp_us = START_US + number * 33_000
        box = Boxes(
            stamp_us,
            "optical",
            np.array([[300.0, 100, 340, 400]]),
            np.array([0.9]),
            ("person",),
            np.array([-1]),
        )
        perception.take(Received(stamp_us, "/boxes", box))
    perception.flush()
    return perception


def test_camera_info_of_another_frame_is_taken_where_it_is_of_the_images() -> None:
    one = played(is_one_camera=True)
    assert (one.feeders["/boxes"].used, one.left_out) == (20, {})
    other = played(is_one_camera=False)
    assert other.feeders["/boxes"].used == 0
    ((why, count),) = other.left_out.items()
    assert why.startswith("eye: its images are of the frame 'optical', and camera_info is of 'camera_link'")
    assert count == 20


def test_images_without_camera_info_are_refused(world: World, tmp_path: Path) -> None:
    box = ROS.box([ROS.hypothesis("person", 0.9)], 1.0, 1.0, (1.0, 1.0))
    found = ROS.make("vision_msgs/Detection2DArray", header=ROS.header(START_NS, "optical"), detections=[box])
    said = [STILL, *scans(), Said("/boxes", "vision_msgs/msg/Detection2DArray", found, START_NS)]
    with pytest.raises(InvalidInput, match="there is no calibration of the camera") as caught:
        ingest_recording(world.dsn, recorded(tmp_path, said))
    assert "--topic boxes=" in caught.value.remedy


def test_a_sensor_that_no_transform_places_is_placed_by_an_option(world: World, tmp_path: Path) -> None:
    plan = recorded(tmp_path, scans())
    place = ["--transform", "map", "laser", "1", "1", "0.3", "0", "0", "-0.5"]
    base = ["ingest", "recording", str(plan.path), "--map", "world", "--dsn", world.dsn, "--source", "robot"]
    ran = CliRunner().invoke(commands(), [*base, *place])
    assert ran.exit_code == 0, ran.output
    ((lines, angle),) = world.rows(
        "select count(*), avg(degrees(atan2(y2_m - y1_m, x2_m - x1_m))) from semap.line_observation"
    )
    assert lines == 8
    assert abs(abs(angle) - 90 + np.degrees(0.5)) < 0.5
