"""How far event time has come on a map, by what its sources say.

The watermark of a map is the least, over its sources, of the source's watermark less its lateness. A source
that is idle holds nothing up until it speaks again. The watermark never goes back, and stays where it is
while all sources are idle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import cast

NEVER_US = -(2**63)


@dataclass(frozen=True)
class SourceMark:
    """How far one source has come; rows may come `lateness_us` after others of later stamps."""

    stamp_us: int
    lateness_us: int = 0
    is_idle: bool = False

    @property
    def complete_us(self) -> int:
        """Up to which all of its rows have come."""
        return max(self.stamp_us - self.lateness_us, NEVER_US)


class Sources:
    """Mutable: the sources of one map.

    released_us  up to which rows have been given to rules
    """

    def __init__(self) -> None:
        self.released_us = NEVER_US
        self._marks: dict[int, SourceMark] = {}

    def watermark(self, source_id: int, stamp_us: int, lateness_us: int) -> None:
        """All rows of this source up to here have come, but for those late by less than the lateness."""
        known = self._marks.get(source_id)
        if known is not None:
            stamp_us = max(stamp_us, known.stamp_us)
        self._marks[source_id] = SourceMark(stamp_us, lateness_us)

    def idle(self, source_id: int) -> None:
        """Nothing is to be expected of this source until it speaks again."""
        known = self._marks.get(source_id)
        if known is not None:
            self._marks[source_id] = replace(known, is_idle=True)

    def watermark_us(self) -> int:
        """Up to which all rows of the map have come."""
        waited_for = [mark.complete_us for mark in self._marks.values() if not mark.is_idle]
        if waited_for:
            return max(self.released_us, min(waited_for))
        return max(self.released_us, *(mark.complete_us for mark in self._marks.values()), NEVER_US)

    def as_json(self) -> dict[str, object]:
        return {
            "released_us": self.released_us,
            "sources": {
                str(source_id): {
                    "stamp_us": mark.stamp_us,
                    "lateness_us": mark.lateness_us,
                    "idle": mark.is_idle,
                }
                for source_id, mark in self._marks.items()
            },
        }

    @staticmethod
    def from_json(document: Mapping[str, object]) -> Sources:
        sources = Sources()
        sources.released_us = int(str(document["released_us"]))
        for source_id, mark in cast(Mapping[str, Mapping[str, object]], document["sources"]).items():
            sources._marks[int(source_id)] = SourceMark(
                int(str(mark["stamp_us"])), int(str(mark["lateness_us"])), bool(mark["idle"])
            )
        return sources
