"""What may still come, and which fates it cannot change.

What a source may still send begins at its frontier, and its records are at least its minimum period
apart. Of the two frontiers the earlier one counts: before it, the merged order of records is complete.
Whatever comes can reach those records only through the last of them: either it is matched with a record
that is not among them, or it is not, and a future in which it is not always exists (nothing more comes).
So the fates that are the same with and without the last record are settled.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

from semap_ingest.synchronisation.matching import Record, partners, stamp_of


@dataclass(frozen=True)
class Outlook:
    """What a source may still send: stamps from `frontier_us` on, `min_period_us` apart."""

    frontier_us: int
    min_period_us: int


def settled(pending: Sequence[Record], a: Outlook, b: Outlook, tolerance_us: int) -> list[int | None]:
    """Partners (as `matching.partners` says them) of the first records, as many as no future can change.

    pending  in the order of stamp and side, all stamps of a source before its frontier
    """
    count = bisect_left(pending, min(a.frontier_us, b.frontier_us), key=stamp_of)
    if count == 0:
        return []
    complete = pending[:count]
    found = partners(complete, tolerance_us)
    last, partner = complete[-1], found[-1]
    nearer_than_us = tolerance_us + 1 if partner is None else last.stamp_us - complete[partner].stamp_us
    if not _can_be_taken(pending, count - 1, a, b, nearer_than_us):
        return found
    without_last = partners(complete[:-1], tolerance_us)
    same = 0
    while same < len(without_last) and found[same] == without_last[same]:
        same += 1
    return found[:same]


def _can_be_taken(pending: Sequence[Record], place: int, a: Outlook, b: Outlook, nearer_than_us: int) -> bool:
    """Whether the record at `place`, the last before both frontiers, can be matched with one after it."""
    record = pending[place]
    behind, ahead = ("a", b) if a.frontier_us <= b.frontier_us else ("b", a)
    if record.side == behind:
        has_next = place + 1 < len(pending)
        next_us = pending[place + 1].stamp_us if has_next else ahead.frontier_us
        return next_us - record.stamp_us < nearer_than_us
    return _can_be_drawn(pending, place, a if behind == "a" else b, nearer_than_us)


def _can_be_drawn(pending: Sequence[Record], place: int, outlook: Outlook, nearer_than_us: int) -> bool:
    """Whether the record at `place` can be matched with one to come of the other source.

    pending  from `place` on of one source

    The one to come does best as early as it can be: nearest to this record, farthest from the next. If it is
    nearer to the next all the same, the next has to be drawn from it by one that comes yet later.
    """
    earliest_us = outlook.frontier_us
    for here in range(place, len(pending)):
        comes_us = max(earliest_us, pending[here].stamp_us)
        gap_us = comes_us - pending[here].stamp_us
        if gap_us >= nearer_than_us:
            return False
        if here + 1 == len(pending):
            return True
        nearer_than_us = pending[here + 1].stamp_us - comes_us
        if nearer_than_us >= gap_us:
            return True
        if nearer_than_us <= 0:
            return False
        earliest_us = comes_us + outlook.min_period_us
    return False
