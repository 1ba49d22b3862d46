"""What the bytes of a message mean: its definition, out of the recording, or from here where it carries none.

A recording of ROS 1, and one in MCAP, carries all definitions; an sqlite3 one only since ROS 2 Iron, so that
those of Humble stand in. Not here: vision_msgs as it was before Galactic, which no recording should need.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from typing import Any

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from semap_ingest.recording.passed_over import Unusable

Deserialiser = Callable[[bytes], Any]

MALFORMED = (SerdeError, TypesysError, struct.error, AttributeError, LookupError, TypeError, ValueError)
"""What rosbags, and reading fields of its messages, raise over bytes and definitions that do not fit."""

IDL_SEPARATOR = "=" * 80 + "\n"

OF_BOTH = {
    "vision_msgs/msg/Detection2DArray": "std_msgs/Header header\nDetection2D[] detections",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nDetection3D[] detections",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size",
    "people_msgs/msg/Person": (
        "string name\ngeometry_msgs/Point position\ngeometry_msgs/Point velocity\nfloat64 reliability\n"
        "string[] tagnames\nstring[] tags"
    ),
    "people_msgs/msg/People": "std_msgs/Header header\npeople_msgs/Person[] people",
    "leg_tracker/msg/Person": "geometry_msgs/Pose pose\nuint32 id",
    "leg_tracker/msg/PersonArray": "std_msgs/Header header\nleg_tracker/Person[] people",
    "spencer_tracking_msgs/msg/DetectedPerson": (
        "uint64 detection_id\nfloat64 confidence\ngeometry_msgs/PoseWithCovariance pose\nstring modality"
    ),
    "spencer_tracking_msgs/msg/DetectedPersons": "std_msgs/Header header\nDetectedPerson[] detections",
    "spencer_tracking_msgs/msg/TrackedPersons": "std_msgs/Header header\nTrackedPerson[] tracks",
}

ROS1_DEFINITIONS: Mapping[str, str] = OF_BOTH | {
    "spencer_tracking_msgs/msg/TrackedPerson": (
        "uint64 track_id\nbool is_occluded\nbool is_matched\nuint64 detection_id\nduration age\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms",
    "vision_msgs/msg/Detection2D": (
        "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\n"
        "sensor_msgs/Image source_img"
    ),
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\n"
        "sensor_msgs/PointCloud2 source_cloud"
    ),
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "int64 id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/BoundingBox2D": "geometry_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
}

ROS2_DEFINITIONS: Mapping[str, str] = OF_BOTH | {
    "spencer_tracking_msgs/msg/TrackedPerson": (
        "uint64 track_id\nbool is_occluded\nbool is_matched\nuint64 detection_id\n"
        "builtin_interfaces/Duration age\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    "vision_msgs/msg/Detection2D": (
        "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\nstring id"
    ),
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\nstring id"
    ),
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y",
}


@cache
def built_in_types(is_ros1: bool) -> Typestore:
    """All types of ROS 1 Noetic or ROS 2 Humble, with those of vision_msgs and of person trackers."""
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name, text in (ROS1_DEFINITIONS if is_ros1 else ROS2_DEFINITIONS).items():
        store.register(get_types_from_msg(text, name))
    return store


def deserialiser(name: str, definition: MessageDefinition, is_ros1: bool) -> Deserialiser:
    """From bytes to a message of a type; raises Unusable for bytes that are none."""
    try:
        store = _types(name, definition, is_ros1)
        store.get_msgdef(name)
    except MALFORMED as error:
        reason = f"the definition of {name} cannot be read: {error!r}"
        return lambda _: _refuse(reason)
    deserialise = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr

    def message(raw: bytes) -> Any:
        try:
            return deserialise(raw, name)
        except MALFORMED as error:
            raise Unusable(f"no {name}: {error}") from error

    return message


@lru_cache(maxsize=100)
def _types(name: str, definition: MessageDefinition, is_ros1: bool) -> Typestore:
    """The type and those that it is made of; each recording may define them its own way."""
    if definition.format == MessageDefinitionFormat.NONE or not definition.data.strip():
        return built_in_types(is_ros1)
    store = get_typestore(Stores.EMPTY)
    if definition.format == MessageDefinitionFormat.MSG:
        store.register(get_types_from_msg(definition.data, name))
    else:
        for part in definition.data.split(IDL_SEPARATOR):
            if part.strip():
                store.register(
                    get_types_from_idl(part.partition("\n")[2] if part.startswith("IDL: ") else part)
                )
    return store


def _refuse(reason: str) -> Any:
    raise Unusable(reason)
