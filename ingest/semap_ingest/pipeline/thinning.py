"""Fewer images than were recorded."""

from __future__ import annotations

from collections.abc import Iterator

from semap_ingest.recording.reading import Received
from semap_ingest.sensing.image import CompressedImage, Image


def least_gap_us(images_hz: float) -> float:
    """Between two images at this rate, give or take a tenth."""
    return 0.9e6 / images_hz


def thinned(records: Iterator[Received], images_hz: float | None) -> Iterator[Received]:
    """Without the images that come sooner after the last one than at this rate."""
    if images_hz is None:
        yield from records
        return
    gap_us = least_gap_us(images_hz)
    last_us: int | None = None
    for received in records:
        if isinstance(received.value, Image | CompressedImage):
            stamp_us = received.value.stamp_us
            if last_us is not None and 0 <= stamp_us - last_us < gap_us:
                continue
            last_us = stamp_us
        yield received
