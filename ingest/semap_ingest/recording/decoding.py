"""From a message of ROS 1 or 2 to a value of `sensing`: one table says which type becomes what."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from semap_ingest.recording import camera_message, cloud_message, detection_message
from semap_ingest.recording.header import frame_name, stamp_us
from semap_ingest.recording.passed_over import Flaw, Unusable
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import Camera, CompressedImage, Image
from semap_ingest.sensing.scan import Cloud, Scan
from semap_ingest.sensing.transform import PersonPoses, Transform

Value = Scan | Cloud | Image | CompressedImage | Camera | Transform | PersonPoses | Boxes

SHORTEST_QUATERNION = 1e-3
MOST_TURNED_RAD = 1.05 * 2 * math.pi
"""By the beams of one sweep: a full turn, and what sensors round it to."""

LONGEST_SWEEP_S = 1.0


@dataclass(frozen=True)
class Surroundings:
    """What a message does not say about itself.

    is_static       the transforms of its topic hold at all times
    person_classes  lower-case names of classes that say person
    """

    is_static: bool
    person_classes: frozenset[str]


Decoder = Callable[[Any, int, Surroundings], Iterable[Value | Flaw]]
"""From a message, and when it was written down [us since 1970]. Raises Unusable."""

Read = Callable[[bytes, int], list[Value | Flaw]]
"""The same from its bytes."""


def _alone(decode: Callable[[Any, int], Value]) -> Decoder:
    """The decoder of a message that becomes one value and needs no surroundings."""
    return lambda message, log_us, _: (decode(message, log_us),)


def _scan(message: Any, log_us: int) -> Scan:
    header = message.header
    if not (math.isfinite(message.angle_min) and math.isfinite(message.angle_increment)):
        raise Unusable(f"angles from {message.angle_min} in steps of {message.angle_increment}")
    turned_rad = abs(message.angle_increment) * max(len(message.ranges) - 1, 0)
    if len(message.ranges) > 1 and not 0 < turned_rad <= MOST_TURNED_RAD:
        raise Unusable(
            f"{len(message.ranges)} beams in steps of {message.angle_increment:g} rad do not make one sweep"
        )
    if not message.range_max > max(message.range_min, 0.0):
        raise Unusable(
            f"ranges from {message.range_min:g} m to {message.range_max:g} m, in which nothing lies"
        )
    return Scan(
        stamp_us(header.stamp, log_us),
        frame_name(header.frame_id),
        message.angle_min,
        message.angle_increment,
        message.range_min,
        message.range_max,
        np.array(message.ranges, np.float32),  # of its own: the message's bytes may lie at any address
        _beam_s(message.time_increment, len(message.ranges)),
    )


def _beam_s(told: float, beams: int) -> float:
    """0 where that cannot be: a sweep takes no longer than the slowest of lasers needs."""
    return float(told) if 0 < told * max(beams - 1, 0) <= LONGEST_SWEEP_S else 0.0


def _transforms(message: Any, log_us: int, surroundings: Surroundings) -> Iterator[Value | Flaw]:
    """A bad one does not spoil its neighbours."""
    for each in message.transforms:
        pose = each.transform
        try:
            found: Value | Flaw = _transform(
                each.header,
                each.child_frame_id,
                log_us,
                pose.translation,
                pose.rotation,
                surroundings.is_static,
            )
        except Unusable as error:
            found = error.flaw
        yield found


def _odometry(message: Any, log_us: int) -> Transform:
    pose = message.pose.pose
    return _transform(message.header, message.child_frame_id, log_us, pose.position, pose.orientation, False)


def pose_of_frame(message: Any, log_us: int, frame: str) -> Transform:
    """A PoseStamped, with or without covariance, that says where a frame is; raises Unusable."""
    try:
        pose = getattr(message.pose, "pose", message.pose)
        return _transform(message.header, frame, log_us, pose.position, pose.orientation, False)
    except (AttributeError, TypeError) as error:
        raise Unusable(f"contents that do not fit: {error}") from error


def _transform(header: Any, child_id: str, log_us: int, place: Any, turn: Any, is_static: bool) -> Transform:
    parent, child = frame_name(header.frame_id), frame_name(child_id)
    if not parent or not child or parent == child:
        raise Unusable(f"a transform from {child!r} to {parent!r}")
    translation_m = np.array([place.x, place.y, place.z], np.float64)
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w], np.float64)
    length = math.hypot(turn.x, turn.y, turn.z, turn.w)
    if not (np.isfinite(translation_m).all() and SHORTEST_QUATERNION < length < math.inf):
        raise Unusable(f"from {child!r} to {parent!r}: {translation_m} m, quaternion {quaternion}")
    stamp = stamp_us(header.stamp, log_us)
    return Transform(stamp, parent, child, translation_m, quaternion / length, is_static)


def _persons(message: Any, log_us: int, surroundings: Surroundings) -> Iterator[Value | Flaw]:
    return detection_message.decode_persons(message, log_us, surroundings.person_classes)


DECODERS: Mapping[str, Decoder] = {
    "sensor_msgs/msg/LaserScan": _alone(_scan),
    "sensor_msgs/msg/PointCloud2": _alone(cloud_message.decode_cloud),
    "sensor_msgs/msg/Image": _alone(camera_message.decode_image),
    "sensor_msgs/msg/CompressedImage": _alone(camera_message.decode_compressed_image),
    "sensor_msgs/msg/CameraInfo": _alone(camera_message.decode_camera),
    "tf2_msgs/msg/TFMessage": _transforms,
    "tf/msg/tfMessage": _transforms,
    "nav_msgs/msg/Odometry": _alone(_odometry),
    "geometry_msgs/msg/PoseStamped": _alone(detection_message.decode_pose),
    "geometry_msgs/msg/PoseArray": _alone(detection_message.decode_pose_array),
    "geometry_msgs/msg/PoseWithCovarianceStamped": _alone(detection_message.decode_uncertain_pose),
    "people_msgs/msg/People": _alone(detection_message.decode_people),
    "leg_tracker/msg/PersonArray": _alone(detection_message.decode_person_array),
    "spencer_tracking_msgs/msg/DetectedPersons": _alone(detection_message.decode_detected_persons),
    "spencer_tracking_msgs/msg/TrackedPersons": (
        lambda message, log_us, _: detection_message.decode_tracked_persons(message, log_us)
    ),
    "vision_msgs/msg/Detection2DArray": _alone(detection_message.decode_boxes),
    "vision_msgs/msg/Detection3DArray": _persons,
}


def is_static(topic: str) -> bool:
    """Whether the transforms of a topic hold at all times."""
    return topic.rpartition("/")[2] == "tf_static"


def reader_of(
    topic: str, type_name: str, deserialise: Callable[[bytes], Any], classes: Iterable[str]
) -> Read:
    """All values of one message of a topic.

    classes  which detections in 3D are persons, by any case of letters
    """
    decode = DECODERS[type_name]
    surroundings = Surroundings(is_static(topic), frozenset(name.lower() for name in classes))

    def read(raw: bytes, log_us: int) -> list[Value | Flaw]:
        message = deserialise(raw)
        try:
            return list(decode(message, log_us, surroundings))
        except (AttributeError, TypeError, ValueError, OverflowError) as error:
            raise Unusable(f"contents that do not fit: {error}") from error

    return read
