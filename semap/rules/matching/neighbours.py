"""What a row says of the rows around it in its partition, as further properties of its own.

`prev(x)` and `next(x)`, with whichever offset, and whether a row is the first of its partition, are found out
once, when the row is taken. So conditions that read them ask the row alone, and matches have them with their
rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from semap.rules.row import Row

BEGINS_PARTITION = "begins partition"
"""Of a row, no property that a rule can name; nor are those that `Neighbour.column` names."""


class Neighbour(NamedTuple):
    """A property of another row of the partition.

    direction  prev or next
    offset     how many rows away
    name       of the property; empty for the row's uid
    """

    direction: str
    offset: int
    name: str

    @property
    def column(self) -> str:
        return f"{self.direction} {self.offset} {self.name}"


@dataclass(frozen=True)
class Neighbours:
    """What rows are to say of others.

    begins     whether they say that they are the first of their partition
    window_us  a row as far away as this or farther says nothing [us]
    """

    wanted: frozenset[Neighbour] = frozenset()
    begins: bool = False
    window_us: int = 2**63 - 1

    @cached_property
    def _columns(self) -> tuple[tuple[str, int, str, str], ...]:
        return tuple((*each, each.column) for each in sorted(self.wanted))

    @property
    def behind(self) -> int:
        return max((each.offset for each in self.wanted if each.direction == "prev"), default=0)

    @property
    def ahead(self) -> int:
        return max((each.offset for each in self.wanted if each.direction == "next"), default=0)

    def told(self, row: Row, behind: Sequence[Row], ahead: Sequence[Row], *, begins: bool) -> Row:
        """The row with what it says of the rows behind it (latest last) and ahead (earliest first)."""
        said = dict(row.values)
        if self.begins and begins:
            said[BEGINS_PARTITION] = True
        for direction, offset, name, column in self._columns:
            others = behind if direction == "prev" else ahead
            if offset <= len(others):
                other = others[-offset if direction == "prev" else offset - 1]
                if abs(other.stamp_us - row.stamp_us) < self.window_us:
                    said[column] = other.values.get(name) if name else other.uid
        return row.saying(said)

    def all_told(self, rows: Sequence[Row]) -> Iterator[Row]:
        """The rows of a partition, all of which are there."""
        for place, row in enumerate(rows):
            behind, ahead = rows[max(place - self.behind, 0) : place], rows[place + 1 :][: self.ahead]
            yield self.told(row, behind, ahead, begins=place == 0)


def begins_partition(row: Row) -> bool:
    """Whether it is the first row of its partition."""
    return row.values.get(BEGINS_PARTITION) is True
