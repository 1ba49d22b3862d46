"""Which records of two sources belong together when all of them are known.

All pairs of one record of each source that are at most the tolerance apart are looked at in the order of
their gap, of two equal gaps the earlier pair first, and a pair is taken when both records are still free
and it does not cross one that was taken before. So the nearer of two rivals wins, and the other takes its
next best.

Because pairs do not cross, a pair that is taken has no record between its two: that record would be
nearer to one of them. Only neighbours in the merged order need to be looked at.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple


class Record(NamedTuple):
    """A record of the source `side`."""

    stamp_us: int
    side: str
    item: object


def stamp_of(record: Record) -> int:
    return record.stamp_us


def order_of(record: Record) -> tuple[int, str]:
    """Records are merged by it."""
    return record.stamp_us, record.side


def partners(records: Sequence[Record], tolerance_us: int) -> list[int | None]:
    """The place of each record's partner in `records`, None for those that stay alone.

    records  of both sources, in the order of stamp and side, stamps of one source strictly ascending
    """
    gaps = sorted(
        (later.stamp_us - earlier.stamp_us, place)
        for place, (earlier, later) in enumerate(pairwise(records))
        if earlier.side != later.side
    )
    found: list[int | None] = [None] * len(records)
    for gap_us, place in gaps:
        if gap_us > tolerance_us:
            break
        if found[place] is None and found[place + 1] is None:
            found[place], found[place + 1] = place + 1, place
    return found
