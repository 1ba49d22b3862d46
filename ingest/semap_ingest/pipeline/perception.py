"""From records to persons on the map and lines in it: detect, synchronise, fuse, track.

`take` is given the records of all sensors in the order in which they were sent, and gives what follows from
each: a person's state as soon as no better match of image and scan can come, lines as soon as it is known
where the laser stood. It has no clock and does no I/O: the same records give the same results.

What each record goes through:
    image     decode, find boxes, image tracker                     \\
    scan      find leg clusters, find lines (these go out)            > wait for transform, synchronise,
              fuse, track
    poses     of persons that the robot has found by itself: wait for transform, track
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap.geometry.pose import transform_points
from semap_ingest.frames.transform_buffer import TransformBuffer
from semap_ingest.frames.waiting import GivenUp, Ready, WaitingRecords
from semap_ingest.fusion.persons import SensorGeometry, fuse
from semap_ingest.image.decoding import BrokenImage, decode
from semap_ingest.image.detector import ImageDetector
from semap_ingest.laser.detector import LegDetector
from semap_ingest.lines.segments import find_lines, transform_lines
from semap_ingest.pipeline.found import Found, LinesAt, PersonsAt
from semap_ingest.pipeline.meter import Meter, no_meter
from semap_ingest.recording.reading import Received
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.detections import BOTH, Detections
from semap_ingest.sensing.image import Camera, CompressedImage, Image
from semap_ingest.sensing.lines import Lines
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.sensing.transform import PersonPoses, Transform
from semap_ingest.synchronisation.synchroniser import (
    NEVER_US,
    AloneA,
    AloneB,
    Matched,
    Refused,
    SourceTiming,
    Synchroniser,
)
from semap_ingest.tracking.image_tracker import ImageTracker
from semap_ingest.tracking.map_tracker import MapTracker

MILLISECOND_US = 1_000
T = TypeVar("T")


PLACED_STD_M = 0.4
"""Of a person's position, along the worst axis, up to which its state is told."""

POSE_STD_M = 0.2
"""Of a person's position where its finder does not say."""


@dataclass(frozen=True)
class Timing:
    """What is known of when records come.

    *_period_us   no two records of the source are nearer to one another
    tolerance_us  image and scan of one moment are at most so far apart
    patience_us   a source that is so far behind the other is waited for no more
    """

    image_period_us: int = 0
    scan_period_us: int = 0
    tolerance_us: int = 30 * MILLISECOND_US
    patience_us: int = 250 * MILLISECOND_US


@dataclass(frozen=True)
class Roles:
    """Who looks at what; None where the recording has nothing to look at.

    boxes_given  the robot finds its boxes by itself
    """

    image_detector: ImageDetector | None = None
    leg_detector: LegDetector | None = None
    boxes_given: bool = False

    @property
    def has_camera(self) -> bool:
        return self.image_detector is not None or self.boxes_given


@dataclass(frozen=True, eq=False)
class ScanFound:
    """What was found in one scan."""

    clusters: LegClusters
    lines: Lines


Synchronised = (
    Matched["_Placed[Boxes]", "_Placed[LegClusters]"]
    | AloneA["_Placed[Boxes]"]
    | AloneB["_Placed[LegClusters]"]
    | Refused["_Placed[Boxes]", "_Placed[LegClusters]"]
)


@dataclass(frozen=True, eq=False)
class _Looked(Generic[T]):
    """What a detector found in a record, which waits for its transform."""

    stamp_us: int
    frame: str
    sent_us: int
    found: T


@dataclass(frozen=True, eq=False)
class _Placed(Generic[T]):
    """What was found, and where the sensor stood."""

    frame: str
    sent_us: int
    map_T_sensor: NDArray[np.float64]
    found: T


class Perception:
    """Mutable: transforms, what waits, and the tracks.

    taken     records that were given to it
    left_out  those that could not be used: why, and how many
    """

    def __init__(
        self,
        roles: Roles,
        timing: Timing,
        map_frame: str = "map",
        floor_z_m: float = 0.0,
        meter: Meter = no_meter,
    ) -> None:
        self.taken = 0
        self._roles = roles
        self._timing = timing
        self._map_frame = map_frame
        self._floor_z_m = floor_z_m
        self._meter = meter
        self._transforms = TransformBuffer()
        self._waiting: WaitingRecords[_Looked[Boxes | ScanFound | PersonPoses]] = WaitingRecords(
            self._transforms, map_frame
        )
        self._cameras: dict[str, Camera] = {}
        self._image_tracker = ImageTracker()
        self._map_tracker = MapTracker()
        self._synchroniser = Synchroniser[_Placed[Boxes], _Placed[LegClusters]](
            SourceTiming(timing.image_period_us),
            SourceTiming(timing.scan_period_us),
            timing.tolerance_us,
            timing.patience_us,
        )
        self._scanned_us = NEVER_US
        self._persons_us = NEVER_US
        self._left_out: Counter[str] = Counter()

    @property
    def left_out(self) -> Mapping[str, int]:
        given_up = {
            f"{source}: where it was seen from is not known ({why.value})": count
            for (source, why), count in self._waiting.given_up.items()
        }
        refused = {
            f"{reason} for synchronisation": count for reason, count in self._synchroniser.refused.items()
        }
        return {**self._left_out, **given_up, **refused}

    def take(self, received: Received) -> Found:
        """What follows from this record."""
        self.taken += 1
        value, sent_us = received.value, received.sent_us
        try:
            match value:
                case Transform():
                    with self._meter("transforms"):
                        self._transforms.add(value)
                case Camera():
                    self._cameras[value.frame] = value
                case Image() | CompressedImage():
                    self._look_at_image(value, sent_us)
                case Boxes():
                    self._wait("boxes", value.stamp_us, value.frame, sent_us, self._tracked(value))
                case Scan():
                    self._look_at_scan(value, sent_us)
                case PersonPoses():
                    self._wait("poses", value.stamp_us, value.frame, sent_us, value)
        except InvalidInput as error:
            self._left_out[f"{received.topic}: {error}"] += 1
        with self._meter("transforms"):
            placed = self._waiting.take()
        return self._go_on(placed)

    def flush(self) -> Found:
        """What follows from there being no more records: all that waits, and every track ends."""
        found = self._go_on(self._waiting.flush())
        persons = list(found.persons)
        for each in self._synchroniser.flush():
            persons += self._fused(each)
        sent_us = persons[-1].sent_us if persons else self._persons_us
        persons.append(PersonsAt(self._map_tracker.finish(), sent_us))
        last_us = max(self._persons_us, self._scanned_us)
        mark_us = None if last_us == NEVER_US else last_us
        return Found(tuple(persons), found.lines, mark_us, mark_us)

    def _look_at_image(self, image: Image | CompressedImage, sent_us: int) -> None:
        detector = self._roles.image_detector
        if detector is None:
            return
        if isinstance(image, CompressedImage):
            with self._meter("decode image"):
                decoded = decode(image)
            if isinstance(decoded, BrokenImage):
                self._left_out[f"images: {decoded.reason}"] += 1
                return
            image = decoded
        with self._meter("detect in image"):
            boxes = detector.detect(image)
        self._wait("image", boxes.stamp_us, boxes.frame, sent_us, self._tracked(boxes))

    def _tracked(self, boxes: Boxes) -> Boxes:
        with self._meter("track in image"):
            return self._image_tracker.step(boxes)

    def _look_at_scan(self, scan: Scan, sent_us: int) -> None:
        if self._roles.leg_detector is None:
            return
        with self._meter("find legs"):
            clusters = self._roles.leg_detector.detect(scan)
        with self._meter("find lines"):
            lines = find_lines(scan)
        self._wait("scan", scan.stamp_us, scan.frame, sent_us, ScanFound(clusters, lines))

    def _wait(
        self, source: str, stamp_us: int, frame: str, sent_us: int, found: Boxes | ScanFound | PersonPoses
    ) -> None:
        self._waiting.put(source, _Looked(stamp_us, frame, sent_us, found))

    def _go_on(self, placed: Sequence[Ready[Any] | GivenUp[Any]]) -> Found:
        """What follows from knowing where sensors stood."""
        persons: list[PersonsAt] = []
        lines: list[LinesAt] = []
        for each in placed:
            if isinstance(each, GivenUp):
                continue
            looked: _Looked[Any] = each.record
            match looked.found:
                case Boxes():
                    persons += self._synchronised(looked, each.target_T_frame, looked.found)
                case ScanFound(clusters, found_lines):
                    in_map = transform_lines(found_lines, each.target_T_frame, self._map_frame)
                    lines.append(LinesAt(in_map, float(each.target_T_frame[2, 3]), looked.sent_us))
                    self._scanned_us = max(self._scanned_us, looked.stamp_us)
                    persons += self._synchronised(looked, each.target_T_frame, clusters)
                case PersonPoses():
                    with self._meter("track on map"):
                        detections = persons_on_map(looked.found, each.target_T_frame, self._map_frame)
                        persons.append(PersonsAt(self._map_tracker.step(detections), looked.sent_us))
                    self._persons_us = max(self._persons_us, looked.stamp_us)
        return Found(
            tuple(persons),
            tuple(lines),
            _known(self._persons_mark_us()),
            _known(self._scanned_us if self._roles.leg_detector else self._persons_mark_us()),
        )

    def _synchronised(
        self, looked: _Looked[Any], map_T_sensor: NDArray[np.float64], found: Boxes | LegClusters
    ) -> list[PersonsAt]:
        """What is final now; where only one of the sensors is there, that is each record by itself."""
        if isinstance(found, Boxes):
            camera_saw = _Placed(looked.frame, looked.sent_us, map_T_sensor, found)
            if self._roles.leg_detector is None:
                return self._fused(AloneA(looked.stamp_us, camera_saw))
            with self._meter("synchronise"):
                final = self._synchroniser.add_a(looked.stamp_us, camera_saw)
        else:
            laser_saw = _Placed(looked.frame, looked.sent_us, map_T_sensor, found)
            if not self._roles.has_camera:
                return self._fused(AloneB(looked.stamp_us, laser_saw))
            with self._meter("synchronise"):
                final = self._synchroniser.add_b(looked.stamp_us, laser_saw)
        return [persons for each in final for persons in self._fused(each)]

    def _fused(self, final: Synchronised) -> list[PersonsAt]:
        """The states of persons at the moment of a pair, or of a record that has none.

        An image without a scan tells of the map only while the laser is silent: else its moment is between
        two that both sensors saw.
        """
        camera_saw, laser_saw, stamp_us = _both_sides(final)
        self._persons_us = max(self._persons_us, stamp_us)
        if laser_saw is None and stamp_us < self._scanned_us + 2 * self._timing.tolerance_us:
            return []
        camera = None if camera_saw is None else self._cameras.get(camera_saw.frame)
        if camera_saw is not None and camera is None:
            self._left_out["images: no camera_info has come before them"] += 1
            camera_saw = None
        seen = [each for each in (camera_saw, laser_saw) if each is not None]
        if not seen:
            return []
        geometry = SensorGeometry(
            camera,
            None if camera_saw is None else camera_saw.map_T_sensor,
            None if laser_saw is None else laser_saw.map_T_sensor,
            self._floor_z_m,
        )
        with self._meter("fuse"):
            detections = fuse(
                None if camera_saw is None else tracked_boxes(camera_saw.found),
                None if laser_saw is None else laser_saw.found,
                geometry,
                stamp_us,
                self._map_frame,
            )
        with self._meter("track on map"):
            states = self._map_tracker.step(detections)
        return [PersonsAt(placed_well(states), max(each.sent_us for each in seen))]

    def _persons_mark_us(self) -> int:
        """Up to where no state of a person is still to come."""
        if self._roles.leg_detector is None or not self._roles.has_camera:
            return self._persons_us
        return self._synchroniser.watermark_us


def _both_sides(
    final: Synchronised,
) -> tuple[_Placed[Boxes] | None, _Placed[LegClusters] | None, int]:
    """What the camera and the laser saw, and when: the scan's moment where there is one."""
    match final:
        case Matched():
            return final.a, final.b, final.b_us
        case AloneA():
            return final.item, None, final.stamp_us
        case AloneB():
            return None, final.item, final.stamp_us
        case _:
            return None, None, final.stamp_us


def _known(mark_us: int) -> int | None:
    return None if mark_us <= NEVER_US else mark_us


def tracked_boxes(boxes: Boxes) -> Boxes:
    """Those that the image tracker has in a track: a weak box by itself is hardly ever a person."""
    kept = np.flatnonzero(boxes.track >= 0)
    return replace(
        boxes,
        corners_px=boxes.corners_px[kept],
        score=boxes.score[kept],
        label=tuple(boxes.label[row] for row in kept),
        track=boxes.track[kept],
    )


def placed_well(states: TrackStates) -> TrackStates:
    """Those whose place is known well enough to say in which room they are."""
    std_m = np.sqrt(np.linalg.eigvalsh(states.covariance_m2)[:, -1]) if len(states) else np.zeros(0)
    kept = np.flatnonzero(std_m <= PLACED_STD_M)
    return replace(
        states,
        track=states.track[kept],
        position_m=states.position_m[kept],
        velocity_mps=states.velocity_mps[kept],
        covariance_m2=states.covariance_m2[kept],
        extent_m=states.extent_m[kept],
        heading_rad=states.heading_rad[kept],
    )


def persons_on_map(poses: PersonPoses, map_T_frame: NDArray[np.float64], map_frame: str) -> Detections:
    """Persons that a robot has found by itself, as if both sensors had seen them."""
    count = len(poses.position_m)
    turn = map_T_frame[:2, :2]
    covariance = turn @ poses.covariance_m2 @ turn.T
    unknown = np.isnan(covariance).any(axis=(1, 2))
    covariance[unknown] = np.eye(2) * POSE_STD_M**2
    return Detections(
        poses.stamp_us,
        map_frame,
        transform_points(map_T_frame, poses.position_m)[:, :2],
        covariance,
        poses.score,
        np.full(count, BOTH, dtype=np.uint8),
        np.full((count, 2), np.nan),
        np.full(count, -1, dtype=np.int64),
    )
