import pytest
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
    assert cast_parts([BOXES, PACKED], {"image": PACKED.name}).has("image")


def test_odometry_stands_in_for_transforms():
    assert cast_parts([SCAN, ODOMETRY], {}).has("odometry")
    assert not cast_parts([SCAN, ODOMETRY, TF], {}).has("odometry")


def test_two_scanners_are_a_question_to_the_user():
    back = Topic("/back", SCAN.type, 9)
    with pytest.raises(InvalidInput, match="/back, /scan") as caught:
        cast_parts([SCAN, back], {})
    assert "--topic scan=/back" in caught.value.remedy
    assert cast_parts([SCAN, back], {"scan": "/back"}).topics["scan"] == ("/back",)


@pytest.mark.parametrize(
    ("named", "said"),
    [({"skan": "/scan"}, "no part 'skan'"), ({"scan": "/front"}, "no messages of the topic '/front'")],
)
def test_what_is_not_there_is_said(named, said):
    with pytest.raises(InvalidInput, match=said):
        cast_parts([SCAN], named)


@pytest.mark.parametrize("topics", [[], [TF, GOAL], [Topic("/scan", SCAN.type, 0)]])
def test_a_recording_without_persons_in_it_is_refused(topics):
    with pytest.raises(InvalidInput, match="neither scans nor images"):
        cast_parts(topics, {})
