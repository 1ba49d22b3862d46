"""Cameras in real bags: which topic of an RGB-D camera is taken and why, and how rectified images see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from bags import FORMATS, Ros, Said, write
from perceived import perceived
from semap_ingest.pipeline.ingest_recording import Plan, rig_for
from semap_ingest.pipeline.rig import read_rig
from semap_ingest.pipeline.rig_check import propose
from semap_ingest.recording.reading import Recording

from semap.errors import InvalidInput

START_NS = 1_785_000_000 * 10**9
IMAGE, PACKED, INFO = (f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo"))
ROS = Ros(is_ros1=False)
WIDTH, HEIGHT = 64, 48
COLOUR = bytes(range(256)) * (WIDTH * HEIGHT * 3 // 256)
GREY = bytes(WIDTH * HEIGHT)


def raw(topic: str, encoding: str, frame: str, ros: Ros = ROS) -> Said:
    size = {"rgb8": 3, "mono8": 1, "16UC1": 2}[encoding]
    message = ros.image(
        START_NS, encoding, HEIGHT, WIDTH, WIDTH * size, (COLOUR if size == 3 else GREY * size)
    )
    message.header.frame_id = frame
    return Said(topic, IMAGE, message, START_NS)


def packed(topic: str, is_grey: bool, frame: str, ros: Ros = ROS) -> Said:
    pixels = np.frombuffer(COLOUR, np.uint8).reshape(HEIGHT, WIDTH, 3)
    pixels = np.repeat(pixels[..., :1], 3, axis=2) if is_grey else pixels
    message = ros.compressed(START_NS, cv2.imencode(".jpg", pixels)[1].tobytes(), "jpeg")
    message.header.frame_id = frame
    return Said(topic, PACKED, message, START_NS)


def info(topic: str, ros: Ros = ROS) -> Said:
    return Said(topic, INFO, ros.camera([500.0, 0, 320, 0, 500, 240, 0, 0, 1], []), START_NS)


RGBD = "of the same RGB-D camera shows colours"
DEPTH = "distances and no colours"
CASES = {
    "RealSense": (
        ("/camera/color/image_raw", "rgb8", "color"), ("/camera/depth/image_rect_raw", "16UC1", "depth"),
        ("/camera/infra1/image_rect_raw", "mono8", "infra1"), ("/camera/infra2/image_rect_raw", "mono8", "infra2"),
        ("/camera/aligned_depth_to_color/image_raw", "16UC1", "color"),
    ),
    "Kinect": (
        ("/camera/rgb/image_rect_color", "rgb8", "rgb"), ("/camera/depth/image_raw", "16UC1", "depth"),
        ("/camera/rgb/image_raw", "rgb8", "rgb"), ("/camera/rgb/image_mono", "mono8", "rgb"),
        ("/camera/ir/image_raw", "mono8", "ir"),
    ),
    "two of them": (
        ("/front/color/image_raw", "rgb8", "front"), ("/front/depth/image_raw", "16UC1", "front_depth"),
        ("/rear/color/image_raw", "rgb8", "rear"), ("/rear/depth/image_raw", "16UC1", "rear_depth"),
        ("/rear/infra1/image_raw", "mono8", "rear_infra"),
    ),
    "a grey camera elsewhere": (
        ("/camera/color/image_raw", "rgb8", "color"), ("/camera/depth/image_raw", "16UC1", "depth"),
        ("/gripper/image_raw", "mono8", "gripper"),
    ),
    "stereo": (("/stereo/left/image_raw", "mono8", "left"), ("/stereo/right/image_raw", "mono8", "right")),
}  # fmt: skip
TAKEN = {
    "RealSense": ["/camera/color/image_raw"],
    "Kinect": ["/camera/rgb/image_rect_color"],
    "two of them": ["/front/color/image_raw", "/rear/color/image_raw"],
    "a grey camera elsewhere": ["/camera/color/image_raw", "/gripper/image_raw"],
    "stereo": ["/stereo/left/image_raw", "/stereo/right/image_raw"],
}


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("case", CASES)
def test_of_an_rgb_d_camera_the_colour_is_taken_and_the_rest_is_told(
    tmp_path: Path, case: str, kind: str
) -> None:
    ros = Ros(is_ros1=kind == "ros1")
    path = write(tmp_path, kind, [raw(*each, ros) for each in CASES[case]], ros)
    with Recording(path) as recording:
        rig, left_out = rig_for(recording, Plan("map", "robot", path, image_model=Path("m.onnx")))
        proposed, notes = propose(recording)
    assert list(rig.sensors) == TAKEN[case]
    assert [each.topic for each in proposed.sensors.values()] == TAKEN[case]
    others = {topic: encoding for topic, encoding, _ in CASES[case] if topic not in TAKEN[case]}
    assert left_out.keys() == others.keys()
    for topic, encoding in others.items():
        assert (DEPTH if encoding == "16UC1" else "of the same") in left_out[topic]
        assert f"{topic} is left out: {left_out[topic]}" in notes


def test_why_one_of_the_same_camera_is_taken(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", [raw(*each) for each in CASES["Kinect"]], ROS)
    with Recording(path) as recording:
        _, left_out = rig_for(recording, Plan("map", "robot", path, image_model=Path("m.onnx")))
    rect = "/camera/rgb/image_rect_color of the same camera"
    assert left_out["/camera/rgb/image_raw"] == f"{rect} is rectified"
    assert left_out["/camera/rgb/image_mono"].endswith(RGBD)


def test_colour_is_seen_in_packed_images_whatever_they_are_called(tmp_path: Path) -> None:
    said = [
        packed("/cam/one/image/compressed", True, "one"),
        packed("/cam/two/image/compressed", False, "two"),
        raw("/cam/range/image", "16UC1", "range"),
    ]
    path = write(tmp_path, "mcap", said, ROS)
    with Recording(path) as recording:
        rig, left_out = rig_for(recording, Plan("map", "robot", path, image_model=Path("m.onnx")))
    assert list(rig.sensors) == ["/cam/two/image/compressed"]
    assert left_out["/cam/one/image/compressed"].endswith(RGBD)


STILL = ROS.tf(ROS.transform(START_NS, "map", "camera", (0, 0, 1.2), (-0.5, 0.5, -0.5, 0.5)))
K, D = [500.0, 0, 320, 0, 500, 240, 0, 0, 1], [-0.3, 0.1, 0.0, 0.0, 0.0]
P = [400.0, 0, 300, 0, 0, 400.0, 220, 0, 0, 0, 1, 0]
RECT = "/camera/image_rect_color/boxes"


def where(
    folder: Path, topic: str, projection: Sequence[float], **rig: object
) -> tuple[np.ndarray, dict[str, int]]:
    """Where a person is found whose box ends at a point of the image, in a camera that looks along x."""
    lens = ROS.camera(K, D)
    lens = replace(lens, p=np.array(projection))
    said = [
        Said("/tf_static", "tf2_msgs/msg/TFMessage", STILL, START_NS),
        Said("/camera/camera_info", INFO, lens, START_NS),
    ]
    for stamp in range(START_NS, START_NS + 2 * 10**9, 10**8):
        box = ROS.box([ROS.hypothesis("person", 0.9)], 500.0, 260.0, (60.0, 180.0))
        message = ROS.make(
            "vision_msgs/Detection2DArray", header=ROS.header(stamp, "camera"), detections=[box]
        )
        said.append(Said(topic, "vision_msgs/msg/Detection2DArray", message, stamp))
    path = write(folder, "mcap", said, ROS)
    found, perception = perceived(path)
    places = [each.states.position_m for one in found for each in one.persons if len(each.states)]
    return (places[-1][0] if places else np.zeros(0)), dict(perception.left_out)


def test_rectified_images_are_seen_through_p(tmp_path: Path) -> None:
    """The feet are at the pixel (500, 350), 1.2 m below the camera: by P (200 / 400, 130 / 400) of the distance."""
    place, left_out = where(tmp_path, RECT, P)
    assert left_out == {}
    distance_m = 1.2 / (130 / 400)
    np.testing.assert_allclose(place, [distance_m, -distance_m * 200 / 400], atol=0.35)
    (tmp_path / "raw").mkdir()
    raw_place, _ = where(tmp_path / "raw", "/camera/image_color/boxes", P)
    assert np.hypot(*(raw_place - place)) > 0.7


def test_rectified_images_without_p_are_left_out_with_what_helps(tmp_path: Path) -> None:
    place, left_out = where(tmp_path, RECT, [0.0] * 12)
    assert not len(place)
    ((why, count),) = left_out.items()
    assert "the P of camera_info has no focal length" in why
    assert "rectified: false" in why
    assert count == 20


def test_a_camera_on_a_wall_is_placed_by_four_points_of_the_floor(tmp_path: Path) -> None:
    """Without tf and camera_info: it hangs at (2, 1), 2.5 m high, looks along x and 0.4 rad down, f 600 px."""
    focal, down = 600.0, 0.4
    forward, lower = np.array([np.cos(down), 0, -np.sin(down)]), np.array([-np.sin(down), 0, -np.cos(down)])

    def pixel(place: Sequence[float]) -> tuple[float, float]:
        away = np.array([*place, 0.0][:3]) - (2.0, 1.0, 2.5)
        return 320 - focal * away[1] / (away @ forward), 240 + focal * (away @ lower) / (away @ forward)

    floor = [(5.0, 0.0), (5.2, 2.2), (9.0, 3.0), (8.5, -0.6)]
    words = {
        "width_px": 640,
        "height_px": 480,
        "floor_m": [list(p) for p in floor],
        "pixels": [list(map(float, pixel(p))) for p in floor],
    }
    file = tmp_path / "rig.yaml"
    file.write_text(f"sensors: {{eye: {{kind: camera, topic: /boxes, homography: {words}}}}}")
    said = []
    for stamp in range(START_NS, START_NS + 3 * 10**9, 10**8):
        (x, feet), (_, crown) = pixel((7.0, 1.5)), pixel((7.0, 1.5, 1.7))
        box = ROS.box([ROS.hypothesis("person", 0.9)], x, (feet + crown) / 2, (60.0, feet - crown))
        message = ROS.make(
            "vision_msgs/Detection2DArray", header=ROS.header(stamp, "nowhere"), detections=[box]
        )
        said.append(Said("/boxes", "vision_msgs/msg/Detection2DArray", message, stamp))
    found, perception = perceived(write(tmp_path, "mcap", said, ROS), rig=read_rig(file))
    assert dict(perception.left_out) == {}
    last = [each.states for one in found for each in one.persons if len(each.states)][-1]
    np.testing.assert_allclose(last.position_m, [[7.0, 1.5]], atol=0.3)
    off = np.linalg.solve(np.linalg.cholesky(last.covariance_m2[0]), last.position_m[0] - [7.0, 1.5])
    assert off @ off < 13.8


def test_a_homography_that_is_none_names_what_is_wrong(tmp_path: Path) -> None:
    file = tmp_path / "rig.yaml"
    points = "floor_m: [[1, 0], [2, 0], [3, 0], [4, 0]]"
    for pixels, says in (
        ("[[1, 1], [2, 2], [3, 3], [4, 4]]", "lie on one line"),
        ("[[1, 1], [2, 2], [3, 3], [4, 4], [5, 5]]", "as many points as pixels"),
        ("[[1, 1], [2, 2], [3, 3]]", "pixels"),
    ):
        size = "width_px: 640, height_px: 480"
        file.write_text(
            f"sensors: {{eye: {{kind: camera, topic: /b, homography: {{{size}, {points}, pixels: {pixels}}}}}}}"
        )
        with pytest.raises(InvalidInput, match=says):
            read_rig(file)
