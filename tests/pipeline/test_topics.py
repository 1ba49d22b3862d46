import pytest
from semap_ingest.pipeline.proposal import Wishes, rig_of
from semap_ingest.pipeline.topics import cast_parts
from semap_ingest.recording.reading import Topic

from semap.errors import InvalidInput

SCAN = Topic("/scan", "sensor_msgs/msg/LaserScan", 9)
PACKED = Topic("/camera/image/compressed", "sensor_msgs/msg/CompressedImage", 9)
RAW = Topic("/camera/image_raw", "sensor_msgs/msg/Image", 9)
TF = Topic("/tf", "tf2_msgs/msg/TFMessage", 9)
STATIC = Topic("/tf_static", "tf2_msgs/msg/TFMessage", 1)
BOXES = Topic("/people", "vision_msgs/msg/Detection2DArray", 9)
GOAL = Topic("/goal", "geometry_msgs/msg/PoseStamped", 9)
ODOMETRY = Topic("/odom", "nav_msgs/msg/Odometry", 9)


def test_parts_are_cast_by_type():
    parts = cast_parts([SCAN, PACKED, TF, STATIC, GOAL], {})
    assert parts.topics["scan"] == ("/scan",)
    assert parts.topics["image"] == ("/camera/image/compressed",)
    assert parts.topics["transforms"] == ("/tf", "/tf_static")
    assert "/goal" not in parts.all(), "a pose may be anything"


def test_compressed_images_are_taken_where_there_are_both():
    assert cast_parts([PACKED, RAW], {}).topics["image"] == (PACKED.name,)


def test_a_robot_that_has_looked_itself_spares_semap_the_images():
    parts = cast_parts([BOXES, PACKED], {})
    assert parts.has("boxes")
    assert not parts.has("image")
    assert cast_parts([BOXES, PACKED], {"image": [PACKED.name]}).has("image")


def test_odometry_stands_in_for_transforms():
    assert cast_parts([SCAN, ODOMETRY], {}).has("odometry")
    assert not cast_parts([SCAN, ODOMETRY, TF], {}).has("odometry")


def test_two_scanners_are_a_question_to_the_user():
    back = Topic("/back", SCAN.type, 9)
    with pytest.raises(InvalidInput, match="/back, /scan") as caught:
        cast_parts([SCAN, back], {})
    assert "--topic scan=/back" in caught.value.remedy
    assert cast_parts([SCAN, back], {"scan": ["/back"]}).topics["scan"] == ("/back",)


@pytest.mark.parametrize(
    ("named", "said"),
    [({"skan": ["/scan"]}, "no part 'skan'"), ({"scan": ["/front"]}, "no messages of the topic '/front'")],
)
def test_what_is_not_there_is_said(named, said):
    with pytest.raises(InvalidInput, match=said):
        cast_parts([SCAN], named)


@pytest.mark.parametrize("topics", [[], [TF, GOAL], [Topic("/scan", SCAN.type, 0)]])
def test_a_recording_without_persons_in_it_is_refused(topics):
    with pytest.raises(InvalidInput, match="neither scans nor images"):
        cast_parts(topics, {})


FRONT, BACK = Topic("/front/scan", SCAN.type, 9), Topic("/back/scan", SCAN.type, 9)
EYES = [
    Topic(f"/{side}/{name}", f"sensor_msgs/msg/{kind}", 9)
    for side in ("left", "right")
    for name, kind in (
        ("image/compressed", "CompressedImage"),
        ("image_raw", "Image"),
        ("camera_info", "CameraInfo"),
    )
]


def test_sensors_of_different_frames_are_several() -> None:
    parts = cast_parts([FRONT, BACK, *EYES], {}, frame_of=lambda name: name.split("/")[1])
    assert parts.topics["scan"] == ("/back/scan", "/front/scan")
    assert parts.topics["image"] == ("/left/image/compressed", "/right/image/compressed")
    assert parts.infos == {
        "/left/image/compressed": "/left/camera_info",
        "/right/image/compressed": "/right/camera_info",
    }


def test_two_topics_of_one_frame_are_a_question_and_both_may_be_named() -> None:
    with pytest.raises(InvalidInput, match="several topics could be the scan") as caught:
        cast_parts([FRONT, BACK], {}, frame_of=lambda name: "laser")
    assert "--topic scan=/back/scan --topic scan=/front/scan" in caught.value.remedy
    both = ["/front/scan", "/back/scan"]
    assert cast_parts([FRONT, BACK], {"scan": both}).topics["scan"] == tuple(both)


def test_each_laser_is_the_partner_of_one_camera_at_most() -> None:
    left_laser, right_laser = Topic("/left/scan", SCAN.type, 9), Topic("/right/scan", SCAN.type, 9)
    topics = [left_laser, right_laser, *EYES, Topic("/third/image_raw", RAW.type, 9)]
    rig = rig_of(cast_parts(topics, {}, frame_of=lambda name: name), Wishes())
    assert {name: each.laser for name, each in rig.sensors.items() if each.kind == "camera"} == {
        "/left/image/compressed": "/left/scan",
        "/right/image/compressed": "/right/scan",
        "/third/image_raw": None,
    }
