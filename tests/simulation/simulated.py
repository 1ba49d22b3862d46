"""Courses of events that several tests look at, planned once."""

from functools import cache

import pytest
from semap_ingest.simulation.schedule import Moments, moments
from semap_ingest.simulation.settings import OfficeSettings

SEEDS = (1, 8, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(20, 30)))


@cache
def course(seed: int, people: int = 5) -> Moments:
    return moments(OfficeSettings(seed=seed, people=people))
