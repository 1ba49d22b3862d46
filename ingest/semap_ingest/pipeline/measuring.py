"""What a look says of persons on the map: where each stands, how surely, and what was looked at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from semap_ingest.fusion.persons import SensorGeometry, fuse
from semap_ingest.fusion.sensor_geometry import View
from semap_ingest.fusion.sight import CameraSight, EitherSight, LaserSight
from semap_ingest.laser.standing import centres_on_map
from semap_ingest.pipeline.calibrations import Calibrations
from semap_ingest.pipeline.feeder import Feeder, Placed, ScanFound
from semap_ingest.pipeline.given import persons_on_map
from semap_ingest.pipeline.moments import Look
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.detections import LASER, Detections, Sight, hint_of
from semap_ingest.sensing.transform import PersonPoses


class Measuring:
    """Mutable through the feeders: what stands about, and what was of use."""

    def __init__(
        self,
        feeder_of: Mapping[str, Feeder],
        calibrations: Calibrations,
        map_frame: str,
        floor_z_m: float,
    ) -> None:
        self._feeder_of, self._calibrations = feeder_of, calibrations
        self._map_frame, self._floor_z_m = map_frame, floor_z_m

    def detections(self, look: Look, believed_m: NDArray[np.float64]) -> Detections | None:
        """Persons in a look; None where nothing says how its only camera sees.

        believed_m  (k, 2) [m, map] where tracks are that are believed to be persons
        raises      InvalidInput for a camera that cannot be
        """
        eye, laser = look.eye, look.laser
        if eye is not None and isinstance(eye.looked.found, PersonPoses):
            return self._of_finder(eye, eye.looked.found)
        view = None if eye is None else self._view_of(eye)
        scan = None if laser is None else laser.looked.found
        boxes = None if eye is None or view is None else eye.looked.found
        if isinstance(boxes, Boxes) and eye is not None and view is not None:
            if laser is not None and isinstance(scan, ScanFound):
                return self._of_both(eye, boxes, view, laser, scan, look.stamp_us, believed_m)
            return self._of_camera(eye, boxes, view, look.stamp_us)
        if laser is not None and isinstance(scan, ScanFound):
            return self._of_laser(laser, scan, look.stamp_us, believed_m)
        return None

    def _of_finder(self, eye: Placed, poses: PersonPoses) -> Detections:
        feeder = self._feeder_of[eye.looked.sensor.name]
        feeder.used += 1
        found = persons_on_map(poses, eye.map_T_sensor, self._map_frame, feeder.numbers_of(poses.known_as))
        hint = hint_of(feeder.number, found.hint)
        return replace(found, hint=hint, detected=feeder.sensor.detected, sensor=feeder.number)

    def _of_camera(self, eye: Placed, boxes: Boxes, view: View, stamp_us: int) -> Detections:
        geometry = SensorGeometry(view.camera, view.map_T_camera, None, self._floor_z_m)
        found = fuse(boxes, None, geometry, stamp_us, self._map_frame)
        sensor = eye.looked.sensor
        found = replace(found, tells_all=sensor.tells_all)
        return self._hinted(found, eye, CameraSight(view), sensor.detected)

    def _of_laser(
        self, laser: Placed, scan: ScanFound, stamp_us: int, believed_m: NDArray[np.float64]
    ) -> Detections:
        geometry = SensorGeometry(None, None, laser.map_T_sensor, self._floor_z_m)
        scan = self._weighed(laser, scan)
        clusters = self._feeder_of[laser.looked.sensor.name].things.without(scan.clusters, laser.map_T_sensor)
        found = fuse(None, clusters, geometry, stamp_us, self._map_frame)
        self._learn_things(laser, scan, stamp_us, believed_m)
        sensor = laser.looked.sensor
        number = self._feeder_of[sensor.name].number
        return replace(found, sight=_sight_of(laser, scan), detected=sensor.detected, sensor=number)

    def _of_both(
        self,
        eye: Placed,
        boxes: Boxes,
        view: View,
        laser: Placed,
        scan: ScanFound,
        stamp_us: int,
        believed_m: NDArray[np.float64],
    ) -> Detections:
        geometry = SensorGeometry(view.camera, view.map_T_camera, laser.map_T_sensor, self._floor_z_m)
        clusters = self._feeder_of[laser.looked.sensor.name].things.without(scan.clusters, laser.map_T_sensor)
        found = fuse(boxes, clusters, geometry, stamp_us, self._map_frame)
        seen_m = found.position_m[found.seen_by != LASER]
        self._learn_things(laser, scan, stamp_us, np.concatenate([seen_m, believed_m]))
        sight = EitherSight(CameraSight(view), _sight_of(laser, scan))
        detected = max(eye.looked.sensor.detected, laser.looked.sensor.detected)
        return self._hinted(found, eye, sight, detected)

    def _hinted(self, found: Detections, eye: Placed, sight: Sight, detected: float) -> Detections:
        number = self._feeder_of[eye.looked.sensor.name].number
        hint = hint_of(number, found.hint)
        return replace(found, hint=hint, sight=sight, detected=detected, sensor=number)

    def _weighed(self, laser: Placed, scan: ScanFound) -> ScanFound:
        """With scores by whether clusters stir in their places, where no camera knows better who stands."""
        stirring, clusters = self._feeder_of[laser.looked.sensor.name].stirring, scan.clusters
        if stirring is None:
            return scan
        return replace(scan, clusters=replace(clusters, score=stirring.scores(clusters, laser.map_T_sensor)))

    def _learn_things(
        self, laser: Placed, scan: ScanFound, stamp_us: int, persons_m: NDArray[np.float64]
    ) -> None:
        """persons_m: (k, 2) where persons are known to be"""
        things = self._feeder_of[laser.looked.sensor.name].things
        centre_m = centres_on_map(scan.clusters, laser.map_T_sensor)
        things.learn(stamp_us, centre_m, scan.clusters.score, persons_m)

    def _view_of(self, eye: Placed) -> View | None:
        """Where a camera stood and how it sees, as far as that is known."""
        looked, feeder = eye.looked, self._feeder_of[eye.looked.sensor.name]
        camera = self._calibrations.of(looked.sensor, looked.frame)
        if camera is None:
            feeder.left_out[self._calibrations.why_none(looked.sensor, looked.frame)] += 1
            return None
        feeder.used += 1
        return View(camera, eye.map_T_sensor, self._floor_z_m)


def _sight_of(laser: Placed, scan: ScanFound) -> LaserSight:
    return LaserSight(laser.map_T_sensor, scan.scan)
