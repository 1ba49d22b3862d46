"""What the beginning of a recording tells of when its records come."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import islice, pairwise

from semap_ingest.pipeline.sensor import PATIENCE_US, Seen
from semap_ingest.recording.gathered import Gathered
from semap_ingest.recording.reading import Received

LOOKED_AT = 100
"""So many records of each source."""
SHARE = 0.9
"""Of the shortest gap that was seen: so much of it is taken for granted, since a later one may be shorter.
One that is shorter still costs at most a pair: `Synchroniser` says what becomes of it."""
SPARE = 1.5
"""Of how far a sensor was behind the others: so much patience it gets."""
MOST_PATIENCE_US = 5_000_000
"""Farther behind than that, a clock is wrong rather than a sensor slow."""


@dataclass(frozen=True)
class Timing:
    """Of one topic: the least time between two records, and how far it may be behind the newest of all."""

    period_us: int = 0
    patience_us: int = PATIENCE_US


UNKNOWN = Timing()


def survey(recording: Gathered, topics: Iterable[str]) -> Mapping[str, Timing]:
    """The timing of each topic, as far as its first records tell."""
    return timing_of(
        received for topic in topics for received in islice(recording.records([topic]), LOOKED_AT)
    )


def timing_of(records: Iterable[Received]) -> Mapping[str, Timing]:
    """The timing of each topic, as far as these records tell."""
    stamps: dict[str, list[int]] = defaultdict(list)
    delays: dict[str, list[int]] = defaultdict(list)
    for each in records:
        if isinstance(each.value, Seen):
            stamps[each.topic].append(each.value.stamp_us)
            delays[each.topic].append(each.sent_us - each.value.stamp_us)
    soonest_us = min((min(each) for each in delays.values()), default=0)
    return {
        topic: Timing(int(SHARE * _least_gap_us(each)), _patience_us(max(delays[topic]) - soonest_us))
        for topic, each in stamps.items()
    }


def _least_gap_us(stamps: Iterable[int]) -> int:
    """0 where nothing is known: then nothing is taken for granted."""
    return min((later - earlier for earlier, later in pairwise(sorted(stamps)) if later > earlier), default=0)


def _patience_us(behind_us: int) -> int:
    wanted_us = int(SPARE * behind_us)
    return max(PATIENCE_US, wanted_us) if wanted_us <= MOST_PATIENCE_US else PATIENCE_US
