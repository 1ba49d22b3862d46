"""Sensors as values: what each is, how it is looked at, and when its records come."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from semap.errors import InvalidInput
from semap_ingest.image.detector import ImageDetector
from semap_ingest.laser.detector import LegDetector
from semap_ingest.recording.reading import PERSON_CLASSES
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.detections import DETECTED
from semap_ingest.sensing.image import Camera, CompressedImage, Image
from semap_ingest.sensing.scan import Cloud, Scan
from semap_ingest.sensing.transform import PersonPoses

Kind = Literal["camera", "laser", "finder"]
Seen = Image | CompressedImage | Boxes | Scan | Cloud | PersonPoses
READS: dict[Kind, tuple[type, ...]] = {
    "camera": (Image, CompressedImage, Boxes),
    "laser": (Scan, Cloud),
    "finder": (PersonPoses,),
}

MILLISECOND_US = 1_000
PATIENCE_US = 250 * MILLISECOND_US
TOLERANCE_US = 30 * MILLISECOND_US
MOST = 62
"""As many looks as a moment can have."""


@dataclass(frozen=True, eq=False)
class Sensor:
    """One source of looks at persons.

    name              of its own among the sensors
    kind              a camera has images or boxes, a laser scans; a finder has persons whom it found itself
    topic             of its records
    detector          of persons in a camera's images, or of legs; without one a camera has boxes
    tells_persons     false: a laser that tells of lines only
    slice_m           of clouds: two heights in their frame, between which points make a scan
    partner           name of the laser with whose legs a camera's boxes are fused to one look
    calibration       of a camera, where no camera_info says it
    info_topic        whose camera_info is of its images, whatever frames they name; None: that of their frame
    is_rectified      its images are without distortion: P of camera_info holds in place of K and D
    frame             in which it sees; None: as its records say
    offset_us         added to its stamps, for a clock that is off
    period_us         no two of its records are nearer to one another
    patience_us       so far it may be behind the newest record of all sensors
    least_gap_us      images that come sooner after the last one are not looked at
    person_classes    classes of given boxes that are persons, by any case of letters
    detected          probability that it detects a person in its sight
    tells_all         whom a record does not name is not in sight; false: it tells of some only
    is_followed       its boxes say who is who: somebody else has followed them from image to image
    """

    name: str
    kind: Kind
    topic: str
    detector: ImageDetector | LegDetector | None = None
    tells_persons: bool = True
    slice_m: tuple[float, float] | None = None
    partner: str | None = None
    calibration: Camera | None = None
    info_topic: str | None = None
    is_rectified: bool = False
    frame: str | None = None
    offset_us: int = 0
    period_us: int = 0
    patience_us: int = PATIENCE_US
    least_gap_us: float = 0.0
    person_classes: Collection[str] = PERSON_CLASSES
    detected: float = DETECTED
    is_followed: bool = False
    tells_all: bool = True


def check(sensors: Sequence[Sensor]) -> None:
    """Raises InvalidInput for sensors that cannot be told apart, or a partner that is none."""
    for what, values in (("name", [s.name for s in sensors]), ("topic", [s.topic for s in sensors])):
        twice = sorted({each for each in values if values.count(each) > 1})
        if twice:
            raise InvalidInput(
                f"two sensors have the {what} {twice[0]!r}", f"Give each a {what} of its own.", "sensors"
            )
    if len(sensors) > MOST:
        raise InvalidInput(
            f"{len(sensors)} sensors", f"Bring them in as several sources of at most {MOST}.", "sensors"
        )
    lasers = {each.name for each in sensors if each.kind == "laser" and each.tells_persons}
    taken: set[str] = set()
    for each in sensors:
        if each.partner is None:
            continue
        if each.kind != "camera" or each.partner not in lasers or each.partner in taken:
            raise InvalidInput(
                f"{each.name} cannot be fused with {each.partner!r}",
                "Name a laser that finds persons and is the partner of no other camera:"
                f" {', '.join(sorted(lasers - taken)) or 'there is none'}.",
                "sensors",
            )
        taken.add(each.partner)
