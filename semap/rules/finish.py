"""How what was found becomes a match: measured, and given its confidence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TypeAlias

from semap.rules.bound import chained
from semap.rules.program import Match
from semap.rules.row import Row, Value

Finish: TypeAlias = Callable[..., tuple[Mapping[str, Value], float | None] | None]
"""Measures and confidence of the rows bound (the last first) at a stamp [us]; None: they make no match.

Where they are not the whole match, or it has a number in its partition, these follow: (bound, stamp_us,
whole, number).
"""


def finished(
    match_type: str | None, rows: Iterable[tuple[str, Row]], stamp_us: int, finish: Finish
) -> tuple[Match, ...]:
    """One match of these rows, ascending; none where its type has no event or `finish` drops it."""
    if match_type is None:
        return ()
    kept = tuple(rows)
    bound = chained(kept)
    found = finish(bound, stamp_us) if bound is not None else ({}, None)
    if found is None:
        return ()
    measures, confidence = found
    return (Match(match_type, stamp_us, kept, measures, confidence),)
