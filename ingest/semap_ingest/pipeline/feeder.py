"""What one sensor finds in its records, each by itself: the first half of the way to persons.

    image     decode, find boxes, image tracker
    boxes     those of persons, image tracker
    scan      find leg clusters, find lines
    poses     as they are

Mutable, without clock or I/O: one feeder is the memory of one sensor.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from semap_ingest.image.decoding import BrokenImage, decode
from semap_ingest.image.detector import ImageDetector
from semap_ingest.laser.cloud_slice import sliced
from semap_ingest.laser.detector import LegDetector
from semap_ingest.laser.standing import StandingThings
from semap_ingest.laser.stirring import Stirring
from semap_ingest.lines.segments import find_lines
from semap_ingest.pipeline.calibrations import Calibrations
from semap_ingest.pipeline.given import person_boxes
from semap_ingest.pipeline.meter import Meter
from semap_ingest.pipeline.sensor import Seen, Sensor
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.image import CompressedImage, Image
from semap_ingest.sensing.lines import Lines
from semap_ingest.sensing.scan import Cloud, Scan
from semap_ingest.sensing.transform import PersonPoses
from semap_ingest.tracking.image_tracker import ImageTracker


@dataclass(frozen=True, eq=False)
class ScanFound:
    """What was found in one scan."""

    scan: Scan
    clusters: LegClusters
    lines: Lines


FoundIn = Boxes | ScanFound | Scan | PersonPoses
"""A scan where the laser may have moved meanwhile: what is in it is found once it is known how."""


@dataclass(frozen=True, eq=False)
class Looked:
    """What was found in a record, which waits for its transform."""

    sensor: Sensor
    stamp_us: int
    frame: str
    sent_us: int
    found: FoundIn

    @property
    def last_us(self) -> int:
        """When it ended."""
        return self.stamp_us + (self.found.sweep_us if isinstance(self.found, Scan) else 0)


@dataclass(frozen=True, eq=False)
class Placed:
    """The same, and where the sensor was."""

    looked: Looked
    map_T_sensor: NDArray[np.float64]


class Feeder:
    """One sensor.

    number    its place among the sensors
    things    what stands where its laser looks
    stirring  how much what is there stirs; None where another sensor knows better who stands
    given     records that were given to it, and used: those of them that could tell something
    left_out  why records, or parts of them, could not be used
    """

    def __init__(
        self,
        sensor: Sensor,
        number: int,
        calibrations: Calibrations,
        meter: Meter,
        *,
        is_alone: bool = True,
    ) -> None:
        """is_alone: no camera is this laser's partner"""
        self.sensor, self.number = sensor, number
        self.things = StandingThings()
        self.stirring = Stirring() if is_alone else None
        self.given = self.used = 0
        self.left_out: Counter[str] = Counter()
        self._calibrations = calibrations
        self._meter = meter
        self._image_tracker = ImageTracker()
        self._last_us: int | None = None
        self._number_of: dict[str, int] = {}

    def numbers_of(self, known_as: Iterable[str]) -> NDArray[np.int64]:
        """(n,) a number for each name by which a finder knows somebody; -1 for none."""
        return np.array(
            [self._number_of.setdefault(name, len(self._number_of)) if name else -1 for name in known_as],
            np.int64,
        )

    def look(self, seen: Seen, sent_us: int) -> Looked | None:
        """None where nothing can be found in the record, or it is one too many."""
        if self._is_too_soon(seen):
            return None
        found = self._found_in(seen)
        return None if found is None else Looked(self.sensor, seen.stamp_us, seen.frame, sent_us, found)

    def _is_too_soon(self, seen: Seen) -> bool:
        if self._last_us is not None and seen.stamp_us - self._last_us < self.sensor.least_gap_us:
            return True
        self._last_us = seen.stamp_us
        return False

    def _found_in(self, seen: Seen) -> FoundIn | None:
        match seen:
            case Scan():
                return seen if seen.sweep_us else self.found_in_scan(seen)
            case Cloud():
                return (
                    None
                    if (heights := self.sensor.slice_m) is None
                    else self.found_in_scan(sliced(seen, *heights))
                )
            case PersonPoses():
                return seen
            case Boxes():
                persons = person_boxes(seen, self.sensor.person_classes)
                if len(persons) < len(seen):
                    self.left_out["boxes of something that is not a person"] += len(seen) - len(persons)
                return persons if self.sensor.is_followed else self._tracked(persons)
            case _:
                return self._found_in_image(seen)

    def _found_in_image(self, image: Image | CompressedImage) -> Boxes | None:
        if self.sensor.detector is None:
            return None
        if isinstance(image, CompressedImage):
            with self._meter("decode image"):
                decoded = decode(image)
            if isinstance(decoded, BrokenImage):
                self.left_out[decoded.reason] += 1
                return None
            image = decoded
        camera, (height, width) = self._calibrations.of(self.sensor, image.frame), image.pixels.shape[:2]
        if camera is not None and (camera.width_px, camera.height_px) != (width, height):
            described = f"{camera.width_px} x {camera.height_px}"
            self.left_out[f"images of {width} x {height} px, and camera_info is of {described}"] += 1
            return None
        with self._meter("detect in image"):
            boxes = cast(ImageDetector, self.sensor.detector).detect(image)
        return self._tracked(boxes)

    def _tracked(self, boxes: Boxes) -> Boxes:
        with self._meter("track in image"):
            return tracked_boxes(self._image_tracker.step(boxes))

    def found_in_scan(self, scan: Scan) -> ScanFound:
        """Clusters and lines."""
        if not scan.is_return.any():
            self.left_out["nothing came back in it"] += 1
        else:
            self.used += 1
        with self._meter("find legs"):
            clusters = cast(LegDetector, self.sensor.detector).detect(scan)
        with self._meter("find lines"):
            lines = find_lines(scan)
        return ScanFound(scan, clusters, lines)


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
