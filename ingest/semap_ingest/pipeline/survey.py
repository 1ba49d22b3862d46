"""What the beginning of a recording tells of when its records come."""

from __future__ import annotations

from itertools import islice, pairwise

from semap_ingest.pipeline.roles import Timing
from semap_ingest.pipeline.thinning import least_gap_us
from semap_ingest.pipeline.topics import Parts
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.image import Camera
from semap_ingest.sensing.transform import Transform

LOOKED_AT = 100
"""So many records of each source."""
SHARE = 0.9
"""Of the shortest gap that was seen: so much of it is taken for granted, since a later one may be shorter.
One that is shorter still costs at most a pair: `Synchroniser` says what becomes of it."""


def survey(recording: Recording, parts: Parts, images_hz: float | None) -> Timing:
    """The least time between two images and between two scans, as far as the first ones tell."""
    images, boxes = parts.topics.get("image", ()), parts.topics.get("boxes", ())
    throttled_us = least_gap_us(images_hz) if images_hz and images and not boxes else 0.0
    return Timing(
        image_period_us=int(max(SHARE * _least_gap_us(recording, (*images, *boxes)), throttled_us)),
        scan_period_us=int(SHARE * _least_gap_us(recording, parts.topics.get("scan", ()))),
    )


def _least_gap_us(recording: Recording, topics: tuple[str, ...]) -> int:
    """0 where nothing is known: then nothing is taken for granted."""
    if not topics:
        return 0
    stamps = sorted(
        each.value.stamp_us
        for each in islice(recording.records(topics), LOOKED_AT)
        if not isinstance(each.value, Camera | Transform)
    )
    return min((later - earlier for earlier, later in pairwise(stamps) if later > earlier), default=0)
