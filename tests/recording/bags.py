"""Recordings written by rosbags' own writers, in each of the formats."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from semap_ingest.recording.definitions import built_in_types

FORMATS = ("ros1", "mcap", "sqlite3")
PLUGINS = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}


@dataclass(frozen=True)
class Said:
    """A message, its topic and type, and the time of the log [ns]; bytes are written as they are."""

    topic: str
    type: str
    message: Any
    log_ns: int


class Ros:
    """Makes messages of ROS 1 or ROS 2."""

    def __init__(self, is_ros1: bool, store: Any = None) -> None:
        self.is_ros1 = is_ros1
        self.store = store or built_in_types(is_ros1)

    def make(self, kind: str, **fields: Any) -> Any:
        package, _, name = kind.partition("/")
        return self.store.types[f"{package}/msg/{name}"](**fields)

    def time(self, stamp_ns: int) -> Any:
        return self.make("builtin_interfaces/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)

    def header(self, stamp_ns: int, frame: str) -> Any:
        seq = {"seq": 0} if self.is_ros1 else {}
        return self.make("std_msgs/Header", stamp=self.time(stamp_ns), frame_id=frame, **seq)

    def scan(self, stamp_ns: int, ranges: Sequence[float], frame: str = "laser", step: float = 0.25) -> Any:
        return self.make(
            "sensor_msgs/LaserScan",
            header=self.header(stamp_ns, frame),
            angle_min=-0.5,
            angle_max=0.5,
            angle_increment=step,
            time_increment=0.0,
            scan_time=0.0,
            range_min=0.125,
            range_max=8.0,
            ranges=np.array(ranges, np.float32),
            intensities=np.array([7.0] * len(ranges), np.float32),
        )

    def point(self, place: Sequence[float]) -> Any:
        return self.make("geometry_msgs/Point", x=place[0], y=place[1], z=place[2])

    def vector(self, place: Sequence[float]) -> Any:
        return self.make("geometry_msgs/Vector3", x=place[0], y=place[1], z=place[2])

    def quaternion(self, parts: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> Any:
        x, y, z, w = parts
        return self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, place: Sequence[float], turn: Sequence[float] = (0.0, 0.0, 0.0, 1.0)) -> Any:
        return self.make("geometry_msgs/Pose", position=self.point(place), orientation=self.quaternion(turn))

    def uncertain(self, place: Sequence[float], covariance: Sequence[float] | None = None) -> Any:
        told = np.zeros(36) if covariance is None else np.array(covariance, np.float64)
        return self.make("geometry_msgs/PoseWithCovariance", pose=self.pose(place), covariance=told)

    def transform(
        self,
        stamp_ns: int,
        parent: str,
        child: str,
        place: Sequence[float] = (0.0, 0.0, 0.0),
        turn: Sequence[float] = (0.0, 0.0, 0.0, 1.0),
    ) -> Any:
        return self.make(
            "geometry_msgs/TransformStamped",
            header=self.header(stamp_ns, parent),
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/Transform", translation=self.vector(place), rotation=self.quaternion(turn)
            ),
        )

    def tf(self, *transforms: Any) -> Any:
        return self.make("tf2_msgs/TFMessage", transforms=list(transforms))

    def odometry(self, stamp_ns: int, parent: str, child: str, place: Sequence[float]) -> Any:
        still = self.make(
            "geometry_msgs/Twist", linear=self.vector((0.0,) * 3), angular=self.vector((0.0,) * 3)
        )
        return self.make(
            "nav_msgs/Odometry",
            header=self.header(stamp_ns, parent),
            child_frame_id=child,
            pose=self.uncertain(place),
            twist=self.make("geometry_msgs/TwistWithCovariance", twist=still, covariance=np.zeros(36)),
        )

    def image(self, stamp_ns: int, encoding: str, height: int, width: int, step: int, data: bytes) -> Any:
        return self.make(
            "sensor_msgs/Image",
            header=self.header(stamp_ns, "camera"),
            height=height,
            width=width,
            encoding=encoding,
            is_bigendian=0,
            step=step,
            data=np.frombuffer(data, np.uint8),
        )

    def compressed(self, stamp_ns: int, data: bytes, kind: str = "jpeg") -> Any:
        return self.make(
            "sensor_msgs/CompressedImage",
            header=self.header(stamp_ns, "camera"),
            format=kind,
            data=np.frombuffer(data, np.uint8),
        )

    def camera(
        self, matrix: Sequence[float], distortion: Sequence[float], model: str = "plumb_bob", **more: Any
    ) -> Any:
        area = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False} | more.pop(
            "roi", {}
        )
        arrays = {
            "d": np.array(distortion, np.float64),
            "k": np.array(matrix, np.float64),
            "r": np.eye(3).ravel(),
            "p": np.zeros(12),
        }
        return self.make(
            "sensor_msgs/CameraInfo",
            header=self.header(0, "camera"),
            **({"height": 480, "width": 640, "binning_x": 0, "binning_y": 0} | more),
            distortion_model=model,
            roi=self.make("sensor_msgs/RegionOfInterest", **area),
            **({name.upper(): value for name, value in arrays.items()} if self.is_ros1 else arrays),
        )

    def cloud(self, stamp_ns: int, points: np.ndarray, **more: Any) -> Any:
        """Of a structured array: its fields, at its offsets."""
        codes = {"f4": 7, "f8": 8, "u1": 2, "u2": 4, "i4": 5}
        fields = [
            self.make(
                "sensor_msgs/PointField",
                name=name,
                offset=points.dtype.fields[name][1],
                datatype=codes[points.dtype[name].str[1:]],
                count=1,
            )
            for name in points.dtype.names
        ]
        told = {
            "height": 1,
            "width": points.size,
            "is_bigendian": False,
            "point_step": points.dtype.itemsize,
            "row_step": points.nbytes,
            "data": np.frombuffer(points.tobytes(), np.uint8),
            "is_dense": False,
        }
        return self.make(
            "sensor_msgs/PointCloud2",
            header=self.header(stamp_ns, "velodyne"),
            fields=fields,
            **(told | more),
        )

    def hypothesis(
        self, label: str, score: float, place: Sequence[float] = (0.0, 0.0, 0.0), covariance: Any = None
    ) -> Any:
        pose = self.uncertain(place, covariance)
        if self.is_ros1:
            return self.make("vision_msgs/ObjectHypothesisWithPose", id=int(label), score=score, pose=pose)
        said = self.make("vision_msgs/ObjectHypothesis", class_id=label, score=score)
        return self.make("vision_msgs/ObjectHypothesisWithPose", hypothesis=said, pose=pose)

    def box(
        self, hypotheses: Sequence[Any], x: float, y: float, size: tuple[float, float], theta: float = 0.0
    ) -> Any:
        if self.is_ros1:
            centre = self.make("geometry_msgs/Pose2D", x=x, y=y, theta=theta)
            more = {"source_img": self.image(0, "", 0, 0, 0, b"")}
        else:
            position = self.make("vision_msgs/Point2D", x=x, y=y)
            centre = self.make("vision_msgs/Pose2D", position=position, theta=theta)
            more = {"id": "7"}
        return self.make(
            "vision_msgs/Detection2D",
            header=self.header(0, ""),
            results=list(hypotheses),
            bbox=self.make("vision_msgs/BoundingBox2D", center=centre, size_x=size[0], size_y=size[1]),
            **more,
        )

    def solid(self, hypotheses: Sequence[Any], place: Sequence[float], size: Sequence[float]) -> Any:
        empty = np.zeros(0, np.dtype([("x", "f4")]))
        more = {"source_cloud": self.cloud(0, empty)} if self.is_ros1 else {"id": "7"}
        return self.make(
            "vision_msgs/Detection3D",
            header=self.header(0, ""),
            results=list(hypotheses),
            bbox=self.make("vision_msgs/BoundingBox3D", center=self.pose(place), size=self.vector(size)),
            **more,
        )

    def people(self, stamp_ns: int, places: Mapping[str, Sequence[float]]) -> Any:
        still = self.point((0.0, 0.0, 0.0))
        persons = [
            self.make(
                "people_msgs/Person", name=name, position=self.point(place), velocity=still, reliability=0.5,
                tagnames=[], tags=[],
            )
            for name, place in places.items()
        ]  # fmt: skip
        return self.make("people_msgs/People", header=self.header(stamp_ns, "map"), people=persons)

    def tracked(
        self,
        stamp_ns: int,
        places: Mapping[int, Sequence[float]],
        covariance: Sequence[float] | None = None,
        hidden: Collection[int] = (),
    ) -> Any:
        """Persons of spencer_tracking_msgs by their numbers; the hidden ones are occluded."""
        zero = self.vector((0.0, 0.0, 0.0))
        still = self.make(
            "geometry_msgs/TwistWithCovariance",
            twist=self.make("geometry_msgs/Twist", linear=zero, angular=zero),
            covariance=np.zeros(36),
        )
        age = self.make("builtin_interfaces/Duration", sec=1, nanosec=0)
        tracks = [
            self.make(
                "spencer_tracking_msgs/TrackedPerson", track_id=number, is_occluded=number in hidden,
                is_matched=True, detection_id=0, age=age, pose=self.uncertain(place, covariance), twist=still,
            )
            for number, place in places.items()
        ]  # fmt: skip
        return self.make(
            "spencer_tracking_msgs/TrackedPersons", header=self.header(stamp_ns, "map"), tracks=tracks
        )


def write(
    folder: Path,
    kind: str,
    said: Sequence[Said],
    ros: Ros,
    *,
    little_endian: bool = True,
    name: str = "made",
    definition: str | None = None,
) -> Path:
    """A recording of these messages in one of FORMATS, ROS 2 with this definition; its path."""
    path = folder / (f"{name}.bag" if kind == "ros1" else f"{name}_{kind}")
    writer = Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=PLUGINS[kind])
    with writer:
        more = {} if definition is None else {"msgdef": definition, "rihs01": "RIHS01_0"}
        connections = {
            (topic, type_name): writer.add_connection(topic, type_name, typestore=ros.store, **more)
            for topic, type_name in dict.fromkeys((each.topic, each.type) for each in said)
        }
        for each in said:
            raw = each.message
            if not isinstance(raw, bytes):
                raw = serialised(raw, each.type, ros, little_endian=little_endian)
            writer.write(connections[each.topic, each.type], each.log_ns, raw)
    return path


def serialised(message: Any, type_name: str, ros: Ros, *, little_endian: bool = True) -> bytes:
    if ros.is_ros1:
        return bytes(ros.store.serialize_ros1(message, type_name))
    return bytes(ros.store.serialize_cdr(message, type_name, little_endian=little_endian))


def the_file(path: Path) -> Path:
    """The one file with messages of a recording."""
    return (
        path if path.is_file() else next(each for each in path.iterdir() if each.suffix in {".mcap", ".db3"})
    )
