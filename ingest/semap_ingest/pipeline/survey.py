"""What the beginning of a recording tells of when its records come."""

from __future__ import annotations

from itertools import pairwise, takewhile

from semap_ingest.pipeline.perception import Timing
from semap_ingest.pipeline.topics import Parts
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.image import Camera

LOOKED_AT_US = 5_000_000
SHARE = 0.9
"""Of the shortest gap that was seen: so much of it is taken for granted, since a later one may be shorter."""


def survey(recording: Recording, parts: Parts, images_hz: float | None) -> Timing:
    """The least time between two images and between two scans, as far as the first seconds tell."""
    return Timing(
        image_period_us=_period_us(
            recording, (*parts.topics.get("image", ()), *parts.topics.get("boxes", ())), images_hz
        ),
        scan_period_us=_period_us(recording, parts.topics.get("scan", ()), None),
    )


def _period_us(recording: Recording, topics: tuple[str, ...], at_most_hz: float | None) -> int:
    if not topics:
        return 0
    until_us = recording.start_us + LOOKED_AT_US
    first = takewhile(lambda received: received.sent_us < until_us, recording.records(topics))
    stamps = sorted(each.value.stamp_us for each in first if not isinstance(each.value, Camera))
    gaps = [later - earlier for earlier, later in pairwise(stamps) if later > earlier]
    throttled_us = 0.9e6 / at_most_hz if at_most_hz else 0.0
    return int(max(SHARE * min(gaps, default=0), SHARE * throttled_us))
