"""Streams of random numbers, one for each thing that varies: none depends on how much another drew."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from semap_ingest.simulation.settings import OfficeSettings


class Stream(IntEnum):
    SCHEDULE = 1
    SCAN = 2
    SCAN_CLOCK = 3
    IMAGE = 4
    IMAGE_CLOCK = 5
    IMAGE_DELAY = 6
    CLOUD = 7
    LOCALISATION = 8
    DECORATION = 9
    WALL_CAMERA = 10
    WALL_LASER = 20


def noise(settings: OfficeSettings, stream: Stream, number: int = 0) -> np.random.Generator:
    """The random numbers of the record of that number in a stream."""
    people = settings.people if stream == Stream.SCHEDULE else 0
    return np.random.default_rng([settings.seed, int(stream), people, number])
