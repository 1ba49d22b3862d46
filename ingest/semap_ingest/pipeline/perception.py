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
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from semap.errors import InvalidInput
from semap_ingest.frames.transform_buffer import Missing, TransformBuffer
from semap_ingest.frames.waiting import GivenUp, Ready, WaitingRecords
from semap_ingest.fusion.persons import SensorGeometry, fuse
from semap_ingest.image.decoding import BrokenImage, decode
from semap_ingest.laser.standing import StandingThings, centres_on_map
from semap_ingest.lines.segments import find_lines, transform_lines
from semap_ingest.pipeline.found import Found, LinesAt, PersonsAt
from semap_ingest.pipeline.given import FARTHEST_M, person_boxes, persons_on_map
from semap_ingest.pipeline.meter import Meter, no_meter
from semap_ingest.pipeline.roles import Roles, Timing
from semap_ingest.pipeline.stamp_order import MAX_JUMP_US, Seen, StampOrder
from semap_ingest.recording.reading import Received
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.detections import LASER, Detections
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

T = TypeVar("T")

CAMERA = "camera"

PLACED_STD_M = 0.4
"""Of a person's position, along the worst axis, up to which its state is told."""


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
    placed    those of sensors of which it became known where they were seen from
    frames    that transforms have named
    given     records of each part, and used: those of them that could tell something
    left_out  records that could not be used: why, and how many
    reasons   why it did not become known where sensors stood
    """

    def __init__(
        self,
        roles: Roles,
        timing: Timing,
        map_frame: str = "map",
        floor_z_m: float = 0.0,
        meter: Meter = no_meter,
    ) -> None:
        self.taken = self.placed = 0
        self.frames: set[str] = set()
        self.given: Counter[str] = Counter()
        self.used: Counter[str] = Counter()
        self.reasons: dict[tuple[str, str, Missing], str] = {}
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
            # no period matters that is longer than the other source's patience
            SourceTiming(min(timing.image_period_us, timing.patience_us)),
            SourceTiming(min(timing.scan_period_us, timing.patience_us)),
            timing.tolerance_us,
            timing.patience_us,
        )
        self._order = StampOrder(max(MAX_JUMP_US, 3 * timing.image_period_us, 3 * timing.scan_period_us))
        self._told: set[int] = set()
        self._things = StandingThings()
        self._scanned_us = NEVER_US
        self._persons_us = NEVER_US
        self._left_out: Counter[str] = Counter()

    @property
    def left_out(self) -> Mapping[str, int]:
        refused = {
            f"{reason} for synchronisation": count for reason, count in self._synchroniser.refused.items()
        }
        return {**self._left_out, **self._order.refused, **refused}

    @property
    def given_up(self) -> int:
        """Records of which it did not become known where they were seen from."""
        return sum(self._waiting.given_up.values())

    def take(self, received: Received) -> Found:
        """What follows from this record."""
        self.taken += 1
        value = received.value
        match value:
            case Transform():
                with self._forgiving(received.topic), self._meter("transforms"):
                    self._transforms.add(value)
                    self.frames |= {value.parent, value.child}
            case Camera():
                self._cameras[value.frame] = value
            case Image() | CompressedImage() | Boxes() | Scan() | PersonPoses():
                self.given[part_of(value)] += 1
                for each, seen in self._order.pass_on(received, value):
                    with self._forgiving(each.topic):
                        self._look_at(seen, each.sent_us)
        with self._meter("transforms"):
            placed = self._waiting.take()
        return self._go_on(placed)

    def flush(self) -> Found:
        """What follows from there being no more records: all that waits, and every track ends."""
        self._order.give_up()
        found = self._go_on(self._waiting.flush())
        persons = list(found.persons)
        over_us = max(self._persons_us, self._scanned_us, self._persons_mark_us())
        for each in self._synchroniser.flush():
            persons += self._fused(each)
        over_us = max(over_us, self._persons_us)
        if over_us == NEVER_US:
            return Found()
        # after all that was told to be past, so that it is not past itself
        over_us += 1
        sent_us = persons[-1].sent_us if persons else over_us
        last = replace(self._told_only(self._map_tracker.finish()), stamp_us=over_us)
        return Found((*persons, PersonsAt(last, sent_us)), found.lines, over_us, over_us)

    @contextmanager
    def _forgiving(self, source: str) -> Iterator[None]:
        """What a role cannot use is left out and counted."""
        try:
            yield
        except InvalidInput as error:
            self._left_out[f"{source}: {str(error).removeprefix(f'{error.where}: ')}"] += 1

    def _look_at(self, seen: Seen, sent_us: int) -> None:
        match seen:
            case Boxes():
                persons = person_boxes(seen, self._roles.person_classes)
                if len(persons) < len(seen):
                    self._left_out["boxes of something that is not a person"] += len(seen) - len(persons)
                self._wait("boxes", sent_us, seen, self._tracked(persons))
            case Scan():
                self._look_at_scan(seen, sent_us)
            case PersonPoses():
                self._wait("poses", sent_us, seen, seen)
            case _:
                self._look_at_image(seen, sent_us)

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
        camera, (height, width) = self._camera_of(image.frame), image.pixels.shape[:2]
        if camera is not None and (camera.width_px, camera.height_px) != (width, height):
            described = f"{camera.width_px} x {camera.height_px}"
            self._left_out[f"images: of {width} x {height} px, and camera_info is of {described}"] += 1
            return
        with self._meter("detect in image"):
            boxes = detector.detect(image)
        self._wait("image", sent_us, image, self._tracked(boxes))

    def _tracked(self, boxes: Boxes) -> Boxes:
        with self._meter("track in image"):
            return self._image_tracker.step(boxes)

    def _look_at_scan(self, scan: Scan, sent_us: int) -> None:
        if self._roles.leg_detector is None:
            return
        if not scan.is_return.any():
            self._left_out["scan: nothing came back in it"] += 1
        else:
            self.used["scan"] += 1
        with self._meter("find legs"):
            clusters = self._roles.leg_detector.detect(scan)
        with self._meter("find lines"):
            lines = find_lines(scan)
        self._wait("scan", sent_us, scan, ScanFound(clusters, lines))

    def _wait(self, source: str, sent_us: int, seen: Seen, found: Boxes | ScanFound | PersonPoses) -> None:
        self._waiting.put(source, _Looked(seen.stamp_us, seen.frame, sent_us, found))

    def _go_on(self, placed: Sequence[Ready[Any] | GivenUp[Any]]) -> Found:
        """What follows from knowing where sensors stood."""
        persons: list[PersonsAt] = []
        lines: list[LinesAt] = []
        for each in placed:
            if isinstance(each, GivenUp):
                self._left_out[f"{each.source}: {self._why_given_up(each)}"] += 1
                continue
            self.placed += 1
            if np.abs(each.target_T_frame[:3, 3]).max() > FARTHEST_M:
                self._left_out[f"{each.source}: seen from outside of any map"] += 1
                continue
            with self._forgiving(each.source):
                if isinstance(each.record.found, ScanFound):
                    lines.append(self._lines_at(each))
                persons += self._persons_at(each.record, each.target_T_frame)
        return Found(
            tuple(persons),
            tuple(lines),
            _known(self._persons_mark_us()),
            _known(self._scanned_us if self._roles.leg_detector else self._persons_mark_us()),
        )

    def _why_given_up(self, each: GivenUp[Any]) -> str:
        """As it was the first time."""
        record = each.record
        known = (each.source, record.frame, each.why)
        if known not in self.reasons:
            self.reasons[known] = self._transforms.why_missing(self._map_frame, record.frame, record.stamp_us)
        return f"where it was seen from is not known: {self.reasons[known]}"

    def _camera_of(self, frame: str) -> Camera | None:
        """The camera that has this frame; else the one there is, where it is told to be of the images."""
        known = self._cameras.get(frame)
        if known is None and self._roles.is_one_camera and len(self._cameras) == 1:
            return replace(next(iter(self._cameras.values())), frame=frame)
        return known

    def _without_camera(self, frame: str) -> str:
        if not self._cameras:
            return "images: no camera_info has come before them"
        return (
            f"images: they are of the frame {frame!r}, and camera_info is of"
            f" {', '.join(map(repr, self._cameras))}; where it is of the same camera, name it:"
            " --topic camera_info=TOPIC"
        )

    def _lines_at(self, each: Ready[Any]) -> LinesAt:
        scan: _Looked[ScanFound] = each.record
        self._scanned_us = scan.stamp_us
        in_map = transform_lines(scan.found.lines, each.target_T_frame, self._map_frame)
        return LinesAt(in_map, float(each.target_T_frame[2, 3]), scan.sent_us)

    def _persons_at(self, looked: _Looked[Any], map_T_sensor: NDArray[np.float64]) -> list[PersonsAt]:
        match looked.found:
            case PersonPoses():
                self.used["poses"] += 1
                self._persons_us = looked.stamp_us
                detections = persons_on_map(looked.found, map_T_sensor, self._map_frame)
                return [self._tracked_on_map(detections, looked.sent_us)]
            case _ if self._roles.poses_given:
                return []
            case ScanFound(clusters, _):
                return self._synchronised(looked, map_T_sensor, clusters)
            case _:
                return self._synchronised(looked, map_T_sensor, looked.found)

    def _synchronised(
        self, looked: _Looked[Any], map_T_sensor: NDArray[np.float64], found: Boxes | LegClusters
    ) -> list[PersonsAt]:
        """What is final now; where only one of the sensors is there, that is each record by itself."""
        if isinstance(found, Boxes):
            self.used[CAMERA] += self._camera_of(looked.frame) is not None
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
        if camera_saw is None and laser_saw is None:
            return []
        self._persons_us = max(self._persons_us, stamp_us)
        if laser_saw is None and stamp_us < self._scanned_us + 2 * self._timing.tolerance_us:
            return []
        camera = None if camera_saw is None else self._camera_of(camera_saw.frame)
        if camera_saw is not None and camera is None:
            self._left_out[self._without_camera(camera_saw.frame)] += 1
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
        with self._forgiving("fusion"):
            with self._meter("fuse"):
                detections = fuse(
                    None if camera_saw is None else tracked_boxes(camera_saw.found),
                    None if laser_saw is None else self._without_things(laser_saw),
                    geometry,
                    stamp_us,
                    self._map_frame,
                )
            if laser_saw is not None:
                centre_m = centres_on_map(laser_saw.found, laser_saw.map_T_sensor)
                self._things.learn(stamp_us, centre_m, detections.position_m[detections.seen_by != LASER])
            return [self._tracked_on_map(detections, max(each.sent_us for each in seen))]
        return []

    def _without_things(self, laser_saw: _Placed[LegClusters]) -> LegClusters:
        return self._things.without(laser_saw.found, laser_saw.map_T_sensor)

    def _tracked_on_map(self, detections: Detections, sent_us: int) -> PersonsAt:
        with self._meter("track on map"):
            states = self._map_tracker.step(detections)
        return PersonsAt(self._told_only(placed_well(states)), sent_us)

    def _told_only(self, states: TrackStates) -> TrackStates:
        """Without the ends of tracks that nobody was told of."""
        self._told.update(states.track.tolist())
        self._told.update(track for one in states.amendments for track in (one.track, one.other))
        ended = tuple(one for one in states.ended if one[0] in self._told)
        self._told.difference_update(track for track, _ in ended)
        return states if ended == states.ended else replace(states, ended=ended)

    def _persons_mark_us(self) -> int:
        """Up to where no state of a person is still to come."""
        roles = self._roles
        if roles.poses_given or roles.leg_detector is None or not roles.has_camera:
            return self._persons_us
        return self._synchroniser.watermark_us


def part_of(seen: Seen) -> str:
    """Which part of a recording it is."""
    match seen:
        case Scan():
            return "scan"
        case PersonPoses():
            return "poses"
        case _:
            return CAMERA


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
