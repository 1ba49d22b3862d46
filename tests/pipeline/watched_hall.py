"""A hall of the tests: cameras on walls, persons whose way is known, and the boxes that are seen of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from semap_ingest.fusion.camera_model import project
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.sensor import Sensor
from semap_ingest.recording.reading import Received
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.image import Camera
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.sensing.transform import PersonPoses, Transform

SECOND_US = 1_000_000
START_US = 1_767_604_500 * SECOND_US
BODY_M = np.array([[x, y, z] for x in (-0.22, 0.22) for y in (-0.22, 0.22) for z in (0.0, 1.7)])
Way = Callable[[float], tuple[float, float]]


@dataclass(frozen=True)
class Eye:
    """A camera at a height of 2.2 m that looks along a yaw, 15 degrees down.

    first_s, period_s  when its images are taken
    """

    name: str
    x_m: float
    y_m: float
    yaw_rad: float
    first_s: float = 0.0
    period_s: float = 0.1

    @property
    def camera(self) -> Camera:
        matrix = np.array([[320.0, 0, 320], [0, 320, 240], [0, 0, 1]])
        return Camera(self.name, 640, 480, matrix, np.zeros(5))

    @property
    def map_T_camera(self) -> NDArray[np.float64]:  # noqa: N802  (a frame is a capital)
        # the optical frame looks along z, its x to the right
        turn = Rotation.from_euler("ZY", [self.yaw_rad, np.deg2rad(15)]) * Rotation.from_quat(
            [-0.5, 0.5, -0.5, 0.5]
        )
        pose = np.eye(4)
        pose[:3, :3] = turn.as_matrix()
        pose[:3, 3] = self.x_m, self.y_m, 2.2
        return pose

    def stands(self) -> Transform:
        pose = self.map_T_camera
        turn = Rotation.from_matrix(pose[:3, :3]).as_quat()
        return Transform(START_US, "map", self.name, pose[:3, 3], turn, is_static=True)

    def sensor(self, **more: object) -> Sensor:
        period_us = int(0.9 * self.period_s * SECOND_US)
        return Sensor(self.name, "camera", f"/{self.name}/boxes", **{"period_us": period_us, **more})  # type: ignore[arg-type]

    def box(self, place: tuple[float, float]) -> NDArray[np.float64] | None:
        """x_min, y_min, x_max, y_max [px] of a person; None where no whole body is in the image."""
        points_m = BODY_M + np.array([*place, 0.0])
        in_camera = (points_m - self.map_T_camera[:3, 3]) @ self.map_T_camera[:3, :3]
        pixels = project(in_camera, self.camera)
        box = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
        if not np.isfinite(box).all() or (box[:2] < 0).any() or box[2] > 639 or box[3] > 479:
            return None
        return box

    def records(self, ways: Sequence[Way], until_s: float, delay_s: float = 0.0) -> list[Received]:
        """An image's boxes at each of its times, which arrive by so much later."""
        found = []
        for time_s in np.arange(self.first_s, until_s, self.period_s):
            stamp_us = START_US + round(time_s * SECOND_US)
            seen = [box for way in ways if (box := self.box(way(float(time_s)))) is not None]
            many = len(seen)
            boxes = Boxes(
                stamp_us,
                self.name,
                np.array(seen).reshape(-1, 4),
                np.full(many, 0.9),
                ("person",) * many,
                np.full(many, -1),
            )
            found.append(Received(stamp_us + round(delay_s * SECOND_US), f"/{self.name}/boxes", boxes))
        return found


def told_of(
    ways: Sequence[Way], until_s: float, first_s: float = 0.0, period_s: float = 0.1, place_m: float = 0.05
) -> list[Received]:
    """What a finder of persons says of all of them, wherever they are."""
    found = []
    for time_s in np.arange(first_s, until_s, period_s):
        stamp_us = START_US + round(time_s * SECOND_US)
        position_m = np.array([[*way(float(time_s)), 0.0] for way in ways])
        covariance_m2 = np.tile(np.eye(2) * place_m**2, (len(ways), 1, 1))
        poses = PersonPoses(stamp_us, "map", position_m, covariance_m2, np.ones(len(ways)), ("",) * len(ways))
        found.append(Received(stamp_us, "/people", poses))
    return found


def in_order(*streams: Sequence[Received]) -> list[Received]:
    """As they were sent."""
    return sorted((each for stream in streams for each in stream), key=lambda each: each.sent_us)


def watch(eyes: Sequence[Eye], sensors: Sequence[Sensor], records: Sequence[Received]) -> list[Found]:
    """What follows from each record, after it is known where the cameras are and how they see."""
    perception = Perception(sensors)
    for eye in eyes:
        perception.take(Received(START_US, "/tf_static", eye.stands()))
        perception.take(Received(START_US, f"/{eye.name}/camera_info", eye.camera))
    found = [*(perception.take(each) for each in records), perception.flush()]
    assert perception.left_out == {}
    return found


def states_of(found: Sequence[Found]) -> list[TrackStates]:
    """Those in which somebody is."""
    return [each.states for one in found for each in one.persons if len(each.states)]


def tracks_of(found: Sequence[Found]) -> set[int]:
    return {int(track) for states in states_of(found) for track in states.track}
