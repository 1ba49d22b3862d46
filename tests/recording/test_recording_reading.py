"""Recordings as values: what was written by rosbags' writers comes back, from each format alike."""

import sqlite3
import struct
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import FORMATS, Ros, Said, serialised, the_file, write
from data_sets import data_set
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from semap_ingest.recording.definitions import built_in_types
from semap_ingest.recording.passed_over import Why
from semap_ingest.recording.reading import Received, Recording, Topic
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import Camera, CompressedImage, Image
from semap_ingest.sensing.scan import Cloud, Scan
from semap_ingest.sensing.transform import PersonPoses, Transform

from semap.errors import InvalidInput

SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS
SCAN, TF = "sensor_msgs/msg/LaserScan", "tf2_msgs/msg/TFMessage"


def ros_of(kind: str) -> Ros:
    return Ros(is_ros1=kind == "ros1")


def read(path: Path, **options: Any) -> list[Received]:
    with Recording(path, **options) as recording:
        return list(recording.records())


def assert_same(found: object, expected: object) -> None:
    """Of one type, and equal in each field, arrays bit by bit."""
    assert type(found) is type(expected)
    for name, value in vars(expected).items():
        if isinstance(value, np.ndarray):
            assert getattr(found, name).dtype == value.dtype, name
            np.testing.assert_array_equal(getattr(found, name), value, err_msg=name)
        else:
            assert getattr(found, name) == value, name


@pytest.mark.parametrize("kind", FORMATS)
def test_every_type_comes_back(tmp_path: Path, kind: str) -> None:
    ros = ros_of(kind)
    stamp_ns, stamp_us = START_NS + 1_999, START_NS // 1000 + 1
    covariance = np.diag([0.25, 0.5, 1, 1, 1, 1]).ravel()
    points = np.array([(1, 2, 3), (4, 5, 6)], np.dtype([("x", "f4"), ("y", "f4"), ("z", "f4")]))
    person, turn = "person" if kind != "ros1" else "1", np.array([0.0, 0.0, 0.6, 0.8])
    unsure = np.full((1, 2, 2), np.nan)
    matrix = [500.0, 0, 320, 0, 510, 240, 0, 0, 1]
    cases: list[tuple[str, str, Any, object]] = [
        ("/scan", SCAN, ros.scan(stamp_ns, [1.5, np.inf, np.nan]), Scan(stamp_us, "laser", -0.5, 0.25, 0.125, 8.0, np.array([1.5, np.inf, np.nan], np.float32))),
        ("/image", "sensor_msgs/msg/Image", ros.image(stamp_ns, "rgb8", 1, 2, 6, bytes(range(6))), Image(stamp_us, "camera", np.arange(6, dtype=np.uint8).reshape(1, 2, 3))),
        ("/image/compressed", "sensor_msgs/msg/CompressedImage", ros.compressed(stamp_ns, b"\xff\xd8..."), CompressedImage(stamp_us, "camera", b"\xff\xd8...")),
        ("/camera_info", "sensor_msgs/msg/CameraInfo", ros.camera(matrix, [0.1, -0.2, 0.01, 0.02, 0.3]), Camera("camera", 640, 480, np.array(matrix).reshape(3, 3), np.array([0.1, -0.2, 0.01, 0.02, 0.3]))),
        ("/tf", TF, ros.tf(ros.transform(stamp_ns, "/map", "/odom", (1, 2, 3), turn)), Transform(stamp_us, "map", "odom", np.array([1.0, 2, 3]), turn)),
        ("/robot/tf_static", TF, ros.tf(ros.transform(stamp_ns, "base_link", "laser")), Transform(stamp_us, "base_link", "laser", np.zeros(3), np.array([0.0, 0, 0, 1]), is_static=True)),
        ("/odom", "nav_msgs/msg/Odometry", ros.odometry(stamp_ns, "odom", "base_link", (4, 5, 6)), Transform(stamp_us, "odom", "base_link", np.array([4.0, 5, 6]), np.array([0.0, 0, 0, 1]))),
        ("/points", "sensor_msgs/msg/PointCloud2", ros.cloud(stamp_ns, points), Cloud(stamp_us, "velodyne", np.array([[1, 2, 3], [4, 5, 6]], np.float32))),
        ("/boxes", "vision_msgs/msg/Detection2DArray", ros.make("vision_msgs/Detection2DArray", header=ros.header(stamp_ns, "camera"), detections=[ros.box([ros.hypothesis("3", 0.25), ros.hypothesis(person, 0.75)], 100, 200, (20, 60))]), Boxes(stamp_us, "camera", np.array([[90.0, 170, 110, 230]]), np.array([0.75]), (person,), np.array([-1]))),
        ("/persons", "vision_msgs/msg/Detection3DArray", ros.make("vision_msgs/Detection3DArray", header=ros.header(stamp_ns, "map"), detections=[ros.solid([ros.hypothesis(person, 0.5, (9, 9, 9), covariance)], (1, 2, 3), (0.5, 0.5, 1.8))]), PersonPoses(stamp_us, "map", np.array([[1.0, 2, 3]]), np.array([np.diag([0.25, 0.5])]), np.array([0.5]), ("" if kind == "ros1" else "7",))),
        ("/legs", "leg_tracker/msg/PersonArray", ros.make("leg_tracker/PersonArray", header=ros.header(stamp_ns, "map"), people=[ros.make("leg_tracker/Person", pose=ros.pose((1, 2, 3)), id=4)]), PersonPoses(stamp_us, "map", np.array([[1.0, 2, 3]]), unsure, np.ones(1), ("4",))),
        ("/tracked", "spencer_tracking_msgs/msg/TrackedPersons", ros.tracked(stamp_ns, {9: (1, 2, 3)}, covariance), PersonPoses(stamp_us, "map", np.array([[1.0, 2, 3]]), np.array([np.diag([0.25, 0.5])]), np.ones(1), ("9",))),
        ("/detected", "spencer_tracking_msgs/msg/DetectedPersons", ros.make("spencer_tracking_msgs/DetectedPersons", header=ros.header(stamp_ns, "map"), detections=[ros.make("spencer_tracking_msgs/DetectedPerson", detection_id=3, confidence=0.5, pose=ros.uncertain((1, 2, 3), covariance), modality="rgbd")]), PersonPoses(stamp_us, "map", np.array([[1.0, 2, 3]]), np.array([np.diag([0.25, 0.5])]), np.array([0.5]), ("",))),
        ("/people", "people_msgs/msg/People", ros.people(stamp_ns, {"ann": (1, 2, 3), "bob": (4, 5, 6)}), PersonPoses(stamp_us, "map", np.array([[1.0, 2, 3], [4, 5, 6]]), np.full((2, 2, 2), np.nan), np.array([0.5, 0.5]), ("ann", "bob"))),
        ("/pose", "geometry_msgs/msg/PoseStamped", ros.make("geometry_msgs/PoseStamped", header=ros.header(stamp_ns, "map"), pose=ros.pose((1, 2, 3))), PersonPoses(stamp_us, "map", np.array([[1.0, 2, 3]]), unsure, np.ones(1), ("",))),
        ("/poses", "geometry_msgs/msg/PoseArray", ros.make("geometry_msgs/PoseArray", header=ros.header(stamp_ns, "map"), poses=[ros.pose((1, 2, 3)), ros.pose((4, np.nan, 6))]), PersonPoses(stamp_us, "map", np.array([[1.0, 2, 3]]), unsure, np.ones(1), ("",))),
        ("/uncertain", "geometry_msgs/msg/PoseWithCovarianceStamped", ros.make("geometry_msgs/PoseWithCovarianceStamped", header=ros.header(stamp_ns, "map"), pose=ros.uncertain((1, 2, 3), covariance)), PersonPoses(stamp_us, "map", np.array([[1.0, 2, 3]]), np.array([np.diag([0.25, 0.5])]), np.ones(1), ("",))),
    ]  # fmt: skip
    said = [
        Said(topic, type_name, message, START_NS + index * SECOND_NS)
        for index, (topic, type_name, message, _) in enumerate(cases)
    ]
    path = write(tmp_path, kind, said, ros)
    with Recording(path, person_classes=["Person", "1"]) as recording:
        assert recording.topics == tuple(
            sorted((Topic(t, k, 1) for t, k, _, _ in cases), key=lambda each: each.name)
        )
        assert (recording.start_us, recording.end_us) == (
            START_NS // 1000,
            START_NS // 1000 + (len(cases) - 1) * 1_000_000,
        )
        assert recording.count == len(cases)
        records = list(recording.records())
        assert recording.passed_over == ()
    assert [(each.sent_us, each.topic) for each in records] == [
        (each.log_ns // 1000, each.topic) for each in said
    ]
    for each, (_, _, _, expected) in zip(records, cases, strict=True):
        assert_same(each.value, expected)


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
def test_the_one_file_of_a_folder_can_be_given(tmp_path: Path, kind: str) -> None:
    ros = ros_of(kind)
    path = write(tmp_path, kind, [Said("/scan", SCAN, ros.scan(START_NS, [1]), START_NS)], ros)
    assert_same(read(the_file(path))[0].value, read(path)[0].value)


def test_bytes_of_a_big_endian_machine(tmp_path: Path) -> None:
    ros = ros_of("mcap")
    said = [Said("/scan", SCAN, ros.scan(START_NS + 5_000, [1.5, 2.5]), START_NS)]
    path = write(tmp_path, "mcap", said, ros, little_endian=False)
    expected = Scan(START_NS // 1000 + 5, "laser", -0.5, 0.25, 0.125, 8.0, np.array([1.5, 2.5], np.float32))
    assert_same(read(path)[0].value, expected)


def test_an_sqlite3_recording_of_humble_carries_no_definitions(tmp_path: Path) -> None:
    ros = ros_of("sqlite3")
    boxes = ros.make(
        "vision_msgs/Detection2DArray",
        header=ros.header(START_NS, "camera"),
        detections=[ros.box([ros.hypothesis("person", 0.5)], 1, 2, (2, 2))],
    )
    said = [
        Said("/boxes", "vision_msgs/msg/Detection2DArray", boxes, START_NS),
        Said("/scan", SCAN, ros.scan(START_NS, [1]), START_NS + 1),
    ]
    path = write(tmp_path, "sqlite3", said, ros)
    with closing(sqlite3.connect(the_file(path))) as connection, connection:
        connection.execute("update schema set schema_version = 3")
        connection.execute("drop table message_definitions")
    boxes_read, scan_read = (each.value for each in read(path))
    assert (boxes_read.label, len(scan_read.ranges_m)) == (("person",), 1)


def test_definitions_of_the_recording_come_first(tmp_path: Path) -> None:
    """vision_msgs of ROS 2 Foxy, laid out otherwise than what is built in."""
    ros = Ros(False, built_in_types.__wrapped__(False))
    for name in [name for name in ros.store.types if name.startswith("vision_msgs")]:
        del ros.store.types[name], ros.store.fielddefs[name]
    foxy = {
        "ObjectHypothesisWithPose": "string id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose",
        "BoundingBox2D": "geometry_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
        "Detection2D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\nsensor_msgs/Image source_img\nbool is_tracking\nstring tracking_id",
        "Detection2DArray": "std_msgs/Header header\nDetection2D[] detections",
    }
    for name, text in foxy.items():
        ros.store.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    detection = ros.make(
        "vision_msgs/Detection2D",
        header=ros.header(START_NS + SECOND_NS, "/camera"),
        results=[
            ros.make(
                "vision_msgs/ObjectHypothesisWithPose", id="dog", score=0.5, pose=ros.uncertain((0, 0, 0))
            )
        ],
        bbox=ros.make(
            "vision_msgs/BoundingBox2D",
            center=ros.make("geometry_msgs/Pose2D", x=5.0, y=5.0, theta=0.0),
            size_x=2.0,
            size_y=4.0,
        ),
        source_img=ros.image(0, "", 0, 0, 0, b""),
        is_tracking=True,
        tracking_id="4",
    )
    boxes = ros.make("vision_msgs/Detection2DArray", header=ros.header(0, ""), detections=[detection])
    path = write(tmp_path, "mcap", [Said("/boxes", "vision_msgs/msg/Detection2DArray", boxes, START_NS)], ros)
    expected = Boxes(
        START_NS // 1000 + 1_000_000,
        "camera",
        np.array([[4.0, 3, 6, 7]]),
        np.array([0.5]),
        ("dog",),
        np.array([-1]),
    )
    assert_same(read(path)[0].value, expected)


IDL = """
================================================================================
IDL: geometry_msgs/msg/PoseStamped
module geometry_msgs { module msg {
  struct PoseStamped { std_msgs::msg::Header header; geometry_msgs::msg::Pose pose; };
}; };
================================================================================
IDL: std_msgs/msg/Header
module std_msgs { module msg {
  struct Header { builtin_interfaces::msg::Time stamp; string frame_id; };
}; };
================================================================================
IDL: geometry_msgs/msg/Pose
module geometry_msgs { module msg {
  struct Point { double x; double y; double z; };
  struct Quaternion { double x; double y; double z; double w; };
  struct Pose { geometry_msgs::msg::Point position; geometry_msgs::msg::Quaternion orientation; };
}; };
""".lstrip()


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
@pytest.mark.parametrize(
    ("definition", "count"),
    [(IDL, 1), (IDL.replace("std_msgs::msg::Header", "Nothing"), 0), ("%$ pose", 0), ("", 1)],
)
def test_definitions_in_idl_and_broken_ones(tmp_path: Path, kind: str, definition: str, count: int) -> None:
    ros = ros_of(kind)
    pose = ros.make("geometry_msgs/PoseStamped", header=ros.header(START_NS, "map"), pose=ros.pose((1, 2, 3)))
    said = [Said("/pose", "geometry_msgs/msg/PoseStamped", pose, START_NS)] * 2
    with Recording(write(tmp_path, kind, said, ros, definition=definition)) as recording:
        places = [each.value.position_m.tolist() for each in recording.records()]
        assert places == [[[1, 2, 3]]] * 2 * count
        assert [(each.why, each.count) for each in recording.passed_over] == [(Why.UNDECODABLE, 2)] * (
            1 - count
        )


@pytest.mark.parametrize("kind", FORMATS)
def test_the_order_is_that_of_the_log_and_topics_can_be_chosen(tmp_path: Path, kind: str) -> None:
    ros = ros_of(kind)
    rng = np.random.default_rng(3)
    said = [
        Said(topic, SCAN, ros.scan(START_NS - index, [index]), START_NS + int(log_ns))
        for index, (topic, log_ns) in enumerate(
            zip(rng.choice(["/a", "/b", "/c"], 300).tolist(), rng.permutation(300) * 1000, strict=True)
        )
    ]
    path = write(tmp_path, kind, said, ros)
    in_order = sorted(said, key=lambda each: each.log_ns)
    with Recording(path) as recording:
        for wanted in (None, ["a", "/c"], []):
            expected = [
                each
                for each in in_order
                if wanted is None or each.topic.strip("/") in {w.strip("/") for w in wanted}
            ]
            records = list(recording.records(wanted))
            assert [(each.topic, each.sent_us) for each in records] == [
                (each.topic, each.log_ns // 1000) for each in expected
            ]
            assert [each.value.ranges_m[0] for each in records] == [
                each.message.ranges[0] for each in expected
            ]


def test_a_message_of_tf_is_as_many_values_as_it_has_transforms(tmp_path: Path) -> None:
    ros = ros_of("ros1")
    message = ros.tf(
        ros.transform(START_NS, "map", "odom"),
        ros.transform(START_NS, "odom", "base", turn=(0, 0, 0, 0)),
        ros.transform(START_NS, "odom", "odom"),
        ros.transform(START_NS, "odom", "base", (np.nan, 0, 0)),
        ros.transform(START_NS, "base", "laser", turn=(0, 0, 0, 2)),
    )
    path = write(tmp_path, "ros1", [Said("/tf", TF, message, START_NS)], ros)
    with Recording(path) as recording:
        found = [each.value for each in recording.records()]
        assert [(each.parent, each.child) for each in found] == [("map", "odom"), ("base", "laser")]
        np.testing.assert_array_equal(found[1].quaternion, [0, 0, 0, 1])
        (flaw,) = recording.passed_over
        assert (flaw.topic, flaw.why, flaw.count) == ("/tf", Why.UNDECODABLE, 3)
        assert "from 'base' to 'odom'" in flaw.example


def test_a_stamp_of_zero_is_the_log_s_and_one_that_is_no_time_is_counted(tmp_path: Path) -> None:
    ros = ros_of("mcap")
    told = [0, START_NS - 3 * SECOND_NS, -5, START_NS]
    messages = [ros.scan(0 if stamp < 0 else stamp, [1]) for stamp in told]
    messages[2].header.stamp.sec = -5
    messages[3].header.stamp.nanosec = SECOND_NS
    said = [Said("/scan", SCAN, message, START_NS + index * 1_500) for index, message in enumerate(messages)]
    path = write(tmp_path, "sqlite3", said, ros)
    with closing(sqlite3.connect(the_file(path))) as connection, connection:
        connection.execute("insert into messages select 99, topic_id, -1500, data from messages limit 1")
    with Recording(path) as recording:
        stamps = [each.value.stamp_us for each in recording.records()]
        assert stamps == [START_NS // 1000, START_NS // 1000 - 3_000_000]
        ((topic, why, count),) = [(each.topic, each.why, each.count) for each in recording.passed_over]
        assert (topic, why, count) == ("/scan", Why.BAD_STAMP, 3)


@pytest.mark.parametrize("kind", FORMATS)
def test_messages_that_cannot_be_decoded_are_counted_and_the_rest_is_read(tmp_path: Path, kind: str) -> None:
    ros = ros_of(kind)
    good = serialised(ros.scan(START_NS, [1, 2]), SCAN, ros)
    rotten = [
        b"",
        good[:9],
        good[:-3],
        good + b"12345678",
        b"\xff" * len(good),
        good.replace(b"laser", b"la\xffer"),
    ]
    log = [good, *rotten, good]
    said = [Said("/scan", SCAN, raw, START_NS + index) for index, raw in enumerate(log)]
    said.append(Said("/scan", SCAN, ros.scan(START_NS, [1], step=np.nan), START_NS + 99))
    with Recording(write(tmp_path, kind, said, ros)) as recording:
        for _ in range(2):  # counted anew each time
            assert len(list(recording.records())) == 2
            (flaw,) = recording.passed_over
            assert (flaw.topic, flaw.why, flaw.count) == ("/scan", Why.UNDECODABLE, 7)


def test_a_type_defined_otherwise_is_counted(tmp_path: Path) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float32[] ranges", SCAN))
    ros = Ros(False, store)
    message = store.types[SCAN](ranges=np.ones(2, np.float32))
    with Recording(write(tmp_path, "mcap", [Said("/scan", SCAN, message, START_NS)], ros)) as recording:
        assert list(recording.records()) == []
        assert "header" in recording.passed_over[0].example


def test_topics_of_other_types_are_listed_and_passed_over(tmp_path: Path) -> None:
    ros = ros_of("ros1")
    text = ros.make("std_msgs/String", data="hello")
    said = [
        Said("/scan", SCAN, ros.scan(START_NS, [1]), START_NS),
        Said("/chatter", "std_msgs/msg/String", text, START_NS),
    ]
    with Recording(write(tmp_path, "ros1", said, ros)) as recording:
        assert recording.topics == (
            Topic("/chatter", "std_msgs/msg/String", 1, False),
            Topic("/scan", SCAN, 1),
        )
        assert [each.topic for each in recording.records()] == ["/scan"]
        assert recording.passed_over == ()
        with pytest.raises(InvalidInput, match="/chatter is of the type std_msgs/msg/String"):
            recording.records(["chatter"])
        with pytest.raises(InvalidInput, match="no topic /laser") as error:
            recording.records(["/laser", "scan"])
        assert "/scan" in error.value.remedy


def test_detections_of_other_classes_are_counted(tmp_path: Path) -> None:
    ros = ros_of("sqlite3")
    solids = [
        ros.solid([ros.hypothesis(label, 0.5)] if label else [], (1, 2, 3), (1, 1, 1))
        for label in ("chair", "Person", "", "dog")
    ]
    message = ros.make("vision_msgs/Detection3DArray", header=ros.header(START_NS, "map"), detections=solids)
    with Recording(
        write(tmp_path, "sqlite3", [Said("/d", "vision_msgs/msg/Detection3DArray", message, START_NS)], ros)
    ) as recording:
        (found,) = recording.records()
        np.testing.assert_array_equal(found.value.score, [0.5, 1.0])
        (flaw,) = recording.passed_over
        assert (flaw.why, flaw.count) == (Why.OTHER_CLASS, 2)


def test_without_rosbags_the_remedy_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "semap_ingest.recording.rosbag_file", raising=False)
    monkeypatch.setitem(sys.modules, "rosbags.interfaces", None)
    with pytest.raises(InvalidInput, match="needs rosbags") as error:
        Recording(tmp_path / "some.bag")
    assert error.value.remedy == "pip install 'semap[perception]'"


def test_real_scans_are_what_rosbags_reads() -> None:
    path = data_set("laser_people") / "demo_stationary_simple_environment.bag"
    with Recording(path) as recording:
        assert recording.topics == (Topic("/scan", SCAN, 1265),)
        records = list(recording.records())
        assert recording.passed_over == ()
    assert len(records) == 1265
    with AnyReader([path]) as reader:
        for found, (connection, log_ns, raw) in zip(records, reader.messages(), strict=True):
            message = reader.deserialize(raw, connection.msgtype)
            stamp_ns = message.header.stamp.sec * SECOND_NS + message.header.stamp.nanosec
            assert (found.sent_us, found.value.stamp_us) == (log_ns // 1000, stamp_ns // 1000)
            np.testing.assert_array_equal(found.value.ranges_m, message.ranges)
            assert found.value.angle_step_rad == message.angle_increment


def test_real_labels_and_topics_without_a_slash() -> None:
    folder = data_set("laser_people") / "training_scans_res_0.33"
    with Recording(folder / "positive_3_extracted.bag") as recording:
        assert [(each.name, each.count, each.is_read) for each in recording.topics] == [
            ("/leg_cluster_positions", 175, True),
            ("/training_scan", 175, True),
            ("/visualization_marker_array", 175, False),
        ]
        values = [each.value for each in recording.records()]
        assert sum(isinstance(each, Scan) for each in values) == 175
        assert sum(isinstance(each, PersonPoses) for each in values) == 175
    with Recording(folder / "positive_not_extracted" / "positive_1.bag") as recording:
        assert sum(1 for _ in recording.records(["/right_scan"])) == 400


def test_ranges_lie_aligned_in_memory_whatever_the_bytes_around_them(tmp_path: Path) -> None:
    ros = ros_of("ros1")
    said = [
        Said("/scan", SCAN, ros.scan(START_NS, [1.5], frame="x" * odd), START_NS + odd) for odd in range(4)
    ]
    for each in read(write(tmp_path, "ros1", said, ros)):
        assert each.value.ranges_m.flags.aligned
        assert struct.unpack("<f", each.value.ranges_m.tobytes()) == (1.5,)
