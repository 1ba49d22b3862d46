"""Records of a simulated recording as ROS 2 messages (rosbags' definitions of Humble)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys.store import Typestore

from semap_ingest.recording.definitions import built_in_types
from semap_ingest.sensing.image import Camera
from semap_ingest.simulation.laser_view import (
    ANGLE_MIN_RAD,
    ANGLE_STEP_RAD,
    BEAM_S,
    BEAMS,
    PERIOD_S,
    RANGE_MAX_M,
    RANGE_MIN_M,
)
from semap_ingest.simulation.localisation import Pose

SCAN, IMAGE, INFO, TF, STATIC_TF, CLOUD = (
    "/scan", "/camera/image/compressed", "/camera/camera_info", "/tf", "/tf_static", "/velodyne_points",
)  # fmt: skip
TYPES = {
    SCAN: "sensor_msgs/msg/LaserScan",
    IMAGE: "sensor_msgs/msg/CompressedImage",
    INFO: "sensor_msgs/msg/CameraInfo",
    TF: "tf2_msgs/msg/TFMessage",
    STATIC_TF: "tf2_msgs/msg/TFMessage",
    CLOUD: "sensor_msgs/msg/PointCloud2",
}
OF_WALLS = {"scan": TYPES[SCAN], "camera_info": TYPES[INFO], "boxes": "vision_msgs/msg/Detection2DArray"}
FLOAT32 = 7
"""sensor_msgs/PointField.FLOAT32"""


@dataclass(frozen=True)
class Record:
    """A message as it is written: log_us is when it was recorded."""

    log_us: int
    topic: str
    data: bytes


@cache
def typestore() -> Typestore:
    return built_in_types(is_ros1=False)


def type_of(topic: str) -> str:
    """Of the messages of a topic, also of one that is named after a sensor on a wall."""
    return TYPES.get(topic) or OF_WALLS[topic.rpartition("/")[2]]


def scan_data(stamp_us: int, ranges_m: NDArray[np.float32], frame: str = "laser") -> bytes:
    return _serialised(
        SCAN,
        header=_header(stamp_us, frame),
        angle_min=ANGLE_MIN_RAD,
        angle_max=ANGLE_MIN_RAD + ANGLE_STEP_RAD * (BEAMS - 1),
        angle_increment=ANGLE_STEP_RAD,
        time_increment=BEAM_S,
        scan_time=PERIOD_S,
        range_min=RANGE_MIN_M,
        range_max=RANGE_MAX_M,
        ranges=ranges_m,
        intensities=np.zeros(0, dtype=np.float32),
    )


def image_data(stamp_us: int, frame: str, jpeg: bytes) -> bytes:
    data = np.frombuffer(jpeg, dtype=np.uint8)
    return _serialised(IMAGE, header=_header(stamp_us, frame), format="rgb8; jpeg compressed bgr8", data=data)


def camera_info_data(stamp_us: int, camera: Camera) -> bytes:
    projection = np.column_stack([camera.matrix, np.zeros(3)])
    region = typestore().types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return _serialised(
        INFO,
        header=_header(stamp_us, camera.frame),
        height=camera.height_px,
        width=camera.width_px,
        distortion_model=camera.model,
        d=camera.distortion,
        k=camera.matrix.ravel(),
        r=np.eye(3).ravel(),
        p=projection.ravel(),
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def boxes_data(
    stamp_us: int, frame: str, corners_px: NDArray[np.float64], scores: NDArray[np.float64]
) -> bytes:
    """corners_px (n, 4) x_min, y_min, x_max, y_max of persons"""
    make, header = typestore().types, _header(stamp_us, frame)
    found = []
    for (x_min, y_min, x_max, y_max), score in zip(corners_px.tolist(), scores.tolist(), strict=True):
        middle = make["vision_msgs/msg/Point2D"]((x_min + x_max) / 2, (y_min + y_max) / 2)
        centre = make["vision_msgs/msg/Pose2D"](middle, 0.0)
        box = make["vision_msgs/msg/BoundingBox2D"](centre, x_max - x_min, y_max - y_min)
        result = make["vision_msgs/msg/ObjectHypothesisWithPose"](
            make["vision_msgs/msg/ObjectHypothesis"]("person", score), _nowhere()
        )
        found.append(make["vision_msgs/msg/Detection2D"](header, [result], box, ""))
    return _serialised("/boxes", header=header, detections=found)


def _nowhere() -> Any:
    """The pose of a detection that has none: a covariance of zero is none."""
    make = typestore().types
    turn = make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    pose = make["geometry_msgs/msg/Pose"](make["geometry_msgs/msg/Point"](0.0, 0.0, 0.0), turn)
    return make["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))


def tf_data(topic: str, stamp_us: int, edges: Sequence[tuple[str, str, Pose]]) -> bytes:
    """parent, child and the child's pose in the parent, all with one stamp"""
    types = typestore().types
    transforms = []
    for parent, child, (place_m, turned) in edges:
        vector = types["geometry_msgs/msg/Vector3"](*place_m)
        quaternion = types["geometry_msgs/msg/Quaternion"](*turned)
        transform = types["geometry_msgs/msg/Transform"](translation=vector, rotation=quaternion)
        transforms.append(
            types["geometry_msgs/msg/TransformStamped"](
                header=_header(stamp_us, parent), child_frame_id=child, transform=transform
            )
        )
    return _serialised(topic, transforms=transforms)


def cloud_data(stamp_us: int, points_m: NDArray[np.float32]) -> bytes:
    field = typestore().types["sensor_msgs/msg/PointField"]
    return _serialised(
        CLOUD,
        header=_header(stamp_us, "velodyne"),
        height=1,
        width=len(points_m),
        fields=[field(name, 4 * index, FLOAT32, 1) for index, name in enumerate("xyz")],
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points_m),
        data=np.ascontiguousarray(points_m, dtype="<f4").view(np.uint8).reshape(-1),
        is_dense=True,
    )


def _header(stamp_us: int, frame: str) -> Any:
    types = typestore().types
    seconds, rest_us = divmod(stamp_us, 1_000_000)
    stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=rest_us * 1000)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)


def _serialised(topic: str, **fields: Any) -> bytes:
    store, kind = typestore(), type_of(topic)
    return bytes(store.serialize_cdr(store.types[kind](**fields), kind))
