"""How each camera sees: as its rig says, or the camera_info that came."""

from __future__ import annotations

from dataclasses import replace

from semap_ingest.pipeline.sensor import Sensor
from semap_ingest.sensing.image import Camera


class Calibrations:
    """Mutable: what camera_info has said last, by its frame and by its topic."""

    def __init__(self) -> None:
        self._by_frame: dict[str, Camera] = {}
        self._by_topic: dict[str, Camera] = {}

    def learn(self, topic: str, camera: Camera) -> None:
        self._by_frame[camera.frame] = camera
        self._by_topic[topic] = camera

    def of(self, sensor: Sensor, frame: str) -> Camera | None:
        """The camera whose images are of this frame; None as long as nothing says how it sees."""
        if sensor.calibration is not None:
            return replace(sensor.calibration, frame=frame)
        camera = self._told(sensor, frame)
        if camera is None or not sensor.is_rectified:
            return camera
        return camera.rectified()

    def _told(self, sensor: Sensor, frame: str) -> Camera | None:
        """As camera_info says it."""
        by_topic = self._by_topic.get(sensor.info_topic or "")
        return self._by_frame.get(frame) if by_topic is None else replace(by_topic, frame=frame)

    def why_none(self, sensor: Sensor, frame: str) -> str:
        """Why `of` says None, for people."""
        if self._told(sensor, frame) is not None:
            return (
                "its images are rectified, as its topic says, and the P of camera_info has no focal length;"
                " record the raw images, or write its calibration, or rectified: false, into a rig"
            )
        if not self._by_topic or sensor.info_topic is not None:
            return "no camera_info has come before its images"
        return (
            f"its images are of the frame {frame!r}, and camera_info is of"
            f" {', '.join(map(repr, self._by_frame))}; where it is of the same camera, name it:"
            " --topic camera_info=TOPIC"
        )
