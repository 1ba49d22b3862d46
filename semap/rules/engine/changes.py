"""What either half of the engine asks to be stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from semap.rules.row import Row
from semap.rules.row_json import RowJson, dump_row
from semap.timeline.stamp import to_datetime


@dataclass(frozen=True)
class Late:
    """A row that came after rows of later stamps had been taken.

    watermark_us  up to which they had
    """

    map_id: int
    row: Row
    watermark_us: int

    def as_json(self) -> dict[str, object]:
        """As the functions of the database take it."""
        return {
            "map_id": self.map_id,
            "uid": self.row.uid,
            "input": self.row.values["input"],
            "stamp": to_datetime(self.row.stamp_us).isoformat(),
            "watermark": to_datetime(self.watermark_us).isoformat(),
            "row": dump_row(self.row),
        }


@dataclass(frozen=True)
class Changes:
    """What is to be stored.

    states           by rule and key; None where nothing is to be kept
    pending_added    rows that wait: map, uid, row
    pending_removed  rows that no longer wait: map, uid
    """

    states: Mapping[tuple[int, str], object] = field(default_factory=dict)
    pending_added: Sequence[tuple[int, str, RowJson]] = ()
    pending_removed: Sequence[tuple[int, str]] = ()
    late: Sequence[Late] = ()

    def __add__(self, other: Changes) -> Changes:
        return Changes(
            {**self.states, **other.states},
            [*self.pending_added, *other.pending_added],
            [*self.pending_removed, *other.pending_removed],
            [*self.late, *other.late],
        )
