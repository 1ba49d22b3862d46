"""Who takes part in looking at a recording, and what is known of when its records come."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from semap_ingest.image.detector import ImageDetector
from semap_ingest.laser.detector import LegDetector
from semap_ingest.recording.reading import PERSON_CLASSES

MILLISECOND_US = 1_000


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

    boxes_given     the robot finds its boxes by itself
    poses_given     it finds the persons themselves: scans tell of lines only
    is_one_camera   camera_info is of the images, also where it names another frame
    person_classes  classes of given boxes that are persons, by any case of letters
    """

    image_detector: ImageDetector | None = None
    leg_detector: LegDetector | None = None
    boxes_given: bool = False
    poses_given: bool = False
    is_one_camera: bool = False
    person_classes: Collection[str] = PERSON_CLASSES

    @property
    def has_camera(self) -> bool:
        return self.image_detector is not None or self.boxes_given
