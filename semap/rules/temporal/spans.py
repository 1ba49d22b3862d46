"""Sets of moments: ascending half-open spans of whole microseconds that neither overlap nor touch.

The ends may be -inf and inf.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from math import inf
from typing import TypeAlias

Span: TypeAlias = tuple[float, float]
Spans: TypeAlias = tuple[Span, ...]

NOWHERE: Spans = ()
EVERYWHERE: Spans = ((-inf, inf),)


def union(spans: Iterable[Span]) -> Spans:
    """The moments in any of these spans, given in any order."""
    joined: list[Span] = []
    for start, end in sorted(spans):
        if start >= end:
            continue
        if joined and start <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], end)
        else:
            joined.append((start, end))
    return tuple(joined)


def complement(spans: Spans) -> Spans:
    """All other moments."""
    ends = [-inf, *(end for span in spans for end in span), inf]
    return tuple((start, end) for start, end in zip(ends[::2], ends[1::2], strict=True) if start < end)


def clipped(spans: Spans, start: float, end: float) -> Spans:
    """Those of the moments that lie in [start, end)."""
    return tuple(
        (max(start, one), min(end, other)) for one, other in spans if max(start, one) < min(end, other)
    )


def intersection(one: Spans, other: Spans) -> Spans:
    """The moments in both."""
    return tuple(part for start, end in other for part in clipped(one, start, end))


def before(spans: Spans, least: float, most: float) -> Spans:
    """The moments that lie at least so long and at most so long before one of these."""
    return union((start - most, end - least) for start, end in spans)


def after(spans: Spans, least: float, most: float) -> Spans:
    """The moments that lie at least so long and at most so long after one of these."""
    return union((start + least, end + most) for start, end in spans)


def holds(spans: Spans, moment: float) -> bool:
    """Whether it is one of the moments."""
    place = bisect_right(spans, (moment, inf))
    return place > 0 and moment < spans[place - 1][1]


def first_from(spans: Spans, moment: float) -> float:
    """The first of the moments that is not earlier than this one; inf if there is none."""
    for start, end in spans:
        if moment < end:
            return max(start, moment)
    return inf


def first_outside(spans: Spans, moment: float) -> float:
    """The first moment from this one on that is not among them; inf if all are."""
    for start, end in spans:
        if start <= moment < end:
            return end
    return moment
