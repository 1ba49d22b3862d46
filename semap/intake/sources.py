"""How far event time has come on a map, by what its sources say.

The watermark of a map is up to where the rows of all its awaited sources have come. It never goes back. Where
no source is awaited, it is up to where the rows of any have.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import cast

from semap.rules.engine.step import NEVER_US


@dataclass(frozen=True)
class SourceMark:
    """How far one source has come.

    complete_us  all of its rows up to here have come
    is_awaited   whether more are to be expected: of one that has ended or is silent there are not
    """

    complete_us: int
    is_awaited: bool = True


class Sources:
    """Mutable: the sources of one map.

    released_us  up to which rows have been given to rules
    """

    def __init__(self) -> None:
        self.released_us = NEVER_US
        self._marks: dict[int, SourceMark] = {}

    def watermark(self, source_id: int, complete_us: int, is_awaited: bool = True) -> None:
        """All rows of this source up to here have come."""
        self._marks[source_id] = SourceMark(complete_us, is_awaited)

    def leave_out(self, source_id: int) -> None:
        """Nothing is to be expected of this source, if it is known."""
        if source_id in self._marks:
            self._marks[source_id] = replace(self._marks[source_id], is_awaited=False)

    def watermark_us(self) -> int:
        """Up to which all rows of the map have come."""
        marks = self._marks.values()
        awaited = [mark.complete_us for mark in marks if mark.is_awaited]
        if awaited:
            return max(self.released_us, min(awaited))
        return max((self.released_us, *(mark.complete_us for mark in marks)))

    def as_json(self) -> dict[str, object]:
        return {
            "released_us": self.released_us,
            "sources": {
                str(source_id): {"complete_us": mark.complete_us, "awaited": mark.is_awaited}
                for source_id, mark in self._marks.items()
            },
        }

    @staticmethod
    def from_json(document: Mapping[str, object]) -> Sources:
        sources = Sources()
        sources.released_us = int(str(document["released_us"]))
        for source_id, mark in cast(Mapping[str, Mapping[str, object]], document["sources"]).items():
            sources.watermark(int(source_id), int(str(mark["complete_us"])), bool(mark["awaited"]))
        return sources
