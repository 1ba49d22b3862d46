"""Records of which sensors' stamps can be taken: event time goes on for each sensor, and does not leap.

Refused are a stamp that is not after the last one of the same topic (a clock that was set back, a record that
came twice), one that cannot be stored, and a lone one far ahead of all others: such a record is held until a
second one agrees with it (`clock_jump`).
"""

from __future__ import annotations

from collections import Counter
from typing import cast

from semap.timeline.stamp import EARLIEST, LATEST, to_us
from semap_ingest.pipeline.sensor import Seen
from semap_ingest.recording.reading import Received
from semap_ingest.synchronisation.clock_jump import ClockJumps
from semap_ingest.synchronisation.matching import Record

MAX_JUMP_US = 10_000_000
EARLIEST_US, LATEST_US = to_us(EARLIEST), to_us(LATEST)


class StampOrder:
    """Mutable: how far each topic has come, and the record that is held.

    refused  how many records of each topic were, and why
    """

    def __init__(self, max_jump_us: int = MAX_JUMP_US) -> None:
        self.refused: Counter[str] = Counter()
        self._jumps = ClockJumps(max_jump_us)
        self._last_us: dict[str, int] = {}

    def pass_on(self, received: Received, seen: Seen) -> list[tuple[Received, Seen]]:
        """Those that can be taken now, in the order in which they came; mostly the one that is given."""
        if not EARLIEST_US <= seen.stamp_us < LATEST_US:
            self.refused[f"{received.topic}: the stamp is no time from 1800 to 9998"] += 1
            return []
        record = Record(seen.stamp_us, received.topic, (received, seen))
        in_step, astray = self._jumps.pass_on(record)
        self._refuse(astray)
        return [each for record in in_step for each in self._gone_on(record)]

    def give_up(self) -> None:
        """Nothing more comes: what is held stays out."""
        self._refuse(self._jumps.give_up())

    def _refuse(self, astray: list[Record]) -> None:
        for record in astray:
            received, _ = _content(record)
            self.refused[f"{received.topic}: the stamp is far ahead of all others"] += 1

    def _gone_on(self, record: Record) -> list[tuple[Received, Seen]]:
        received, seen = _content(record)
        last_us = self._last_us.get(received.topic)
        if last_us is not None and seen.stamp_us <= last_us:
            self.refused[f"{received.topic}: the stamp is not after the one before"] += 1
            return []
        self._last_us[received.topic] = seen.stamp_us
        return [(received, seen)]


def _content(record: Record) -> tuple[Received, Seen]:
    return cast(tuple[Received, Seen], record.item)
