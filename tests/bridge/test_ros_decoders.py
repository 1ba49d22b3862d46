"""What is no message, or says what cannot be, is counted and never raised, whatever its bytes are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from semap_bridge.ros.message import messages
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.sensor import Sensor
from semap_ingest.recording.decoding import DECODERS, pose_of_frame, reader_of
from semap_ingest.recording.definitions import deserialiser
from semap_ingest.recording.passed_over import Flaw, Unusable
from semap_ingest.recording.reading import PERSON_CLASSES, Received
from semap_ingest.sensing.transform import PersonPoses

NONE = MessageDefinition(MessageDefinitionFormat.NONE, "")
KINDS = sorted(DECODERS)
FLOATS = st.floats(width=32) | st.sampled_from([0.0, math.nan, math.inf, -math.inf, 1e30])


def valid(type_name: str, is_ros1: bool) -> bytes:
    """A message with one of everything that it lists."""
    m = messages(is_ros1=is_ros1)
    one = {
        "tf2_msgs/msg/TFMessage": ("transforms", "geometry_msgs/msg/TransformStamped"),
        "people_msgs/msg/People": ("people", "people_msgs/msg/Person"),
        "geometry_msgs/msg/PoseArray": ("poses", "geometry_msgs/msg/Pose"),
        "vision_msgs/msg/Detection2DArray": ("detections", "vision_msgs/msg/Detection2D"),
        "vision_msgs/msg/Detection3DArray": ("detections", "vision_msgs/msg/Detection3D"),
    }
    fields = {}
    if type_name in one:
        name, inner = one[type_name]
        fields[name] = [m.new(inner)]
    if type_name == "sensor_msgs/msg/LaserScan":
        fields["ranges"] = np.ones(5, np.float32)
    return m.write(m.new(type_name, **fields))


@settings(max_examples=150)
@given(data=st.data(), is_ros1=st.booleans(), kind=st.sampled_from(KINDS))
def test_any_bytes_are_values_or_flaws(data: st.DataObject, is_ros1: bool, kind: str) -> None:
    """Bytes of nothing, and those of a message of which some were changed or are missing."""
    if kind not in messages(is_ros1=is_ros1).store.fielddefs:
        return
    if data.draw(st.booleans()):
        raw = data.draw(st.binary(max_size=300))
    else:
        changed = bytearray(valid(kind, is_ros1))
        for place, value in data.draw(
            st.lists(st.tuples(st.integers(0, len(changed) - 1), st.integers(0, 255)))
        ):
            changed[place] = value
        raw = bytes(changed[: data.draw(st.integers(0, len(changed)))])
    message_of = deserialiser(kind, NONE, is_ros1)
    try:
        found = reader_of("/topic", kind, message_of, PERSON_CLASSES)(raw, 1)
    except Unusable:
        return
    assert all(isinstance(each, Flaw) or hasattr(each, "frame") or hasattr(each, "child") for each in found)


@given(x=FLOATS, y=FLOATS, reliability=FLOATS, frame=st.text(max_size=5))
def test_people_are_persons_where_they_are_somewhere(
    x: float, y: float, reliability: float, frame: str
) -> None:
    m = messages(is_ros1=False)
    person = m.new("people_msgs/msg/Person", position=m.point(x, y), reliability=reliability)
    raw = m.write(m.new("people_msgs/msg/People", header=m.header(5, "f"), people=[person]))
    read = reader_of("/p", "people_msgs/msg/People", deserialiser("people_msgs/msg/People", NONE, False), ())
    (found,) = read(raw, 1)
    assert isinstance(found, PersonPoses)
    assert len(found.position_m) == (math.isfinite(x) and math.isfinite(y))
    assert all(0 <= score <= 1 for score in found.score)
    perception = Perception([Sensor("people", "finder", "/p")])
    perception.take(Received(1, "/p", found))
    perception.flush()


@pytest.mark.parametrize(("w", "is_one"), [(1.0, True), (0.0, False), (math.nan, False)])
def test_a_pose_of_the_robot_is_a_transform(w: float, is_one: bool) -> None:
    m = messages(is_ros1=True)
    turned = m.new("geometry_msgs/msg/Quaternion", w=w)
    pose = m.new("geometry_msgs/msg/Pose", position=m.point(1, 2), orientation=turned)
    where = m.new("geometry_msgs/msg/PoseWithCovariance", pose=pose)
    told = m.new("geometry_msgs/msg/PoseWithCovarianceStamped", header=m.header(7, "/map"), pose=where)
    if not is_one:
        with pytest.raises(Unusable):
            pose_of_frame(told, 1, "tug")
        return
    found = pose_of_frame(told, 1, "tug")
    assert (found.parent, found.child, found.stamp_us, found.translation_m.tolist()) == (
        "map",
        "tug",
        7,
        [1, 2, 0],
    )
