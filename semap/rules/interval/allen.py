"""The thirteen relations of Allen (1983) between two intervals, by CQL2's names, as far as they are known.

An interval is half-open, [start, end) with start < end; one of no length has no relation to anything. A start
or end that is None lies after everything that is known, so also after each stamp that is given: of a row's
interval that is open at the watermark the end, of one yet to begin both.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

from semap.errors import InvalidInput

SIGNS: Mapping[str, str] = {
    "before": "<<<<",
    "meets": "<<=<",
    "overlaps": "<<><",
    "finishedBy": "<<>=",
    "contains": "<<>>",
    "starts": "=<><",
    "equals": "=<>=",
    "startedBy": "=<>>",
    "during": "><><",
    "finishes": "><>=",
    "overlappedBy": "><>>",
    "metBy": ">=>>",
    "after": ">>>>",
}
"""How left stands to right in each relation: its start to start and end, then its end to start and end."""

RELATIONS = frozenset(SIGNS)
APART = frozenset({"before", "after"})
INTERSECTS = RELATIONS - APART - {"meets", "metBy"}
"""The relations of two intervals that have a moment in common."""

NAMES: Mapping[str, frozenset[str]] = {
    **{name.lower(): frozenset({name}) for name in SIGNS},
    "intersects": INTERSECTS,
}
"""What each word, in lower case, stands for."""


@dataclass(frozen=True, slots=True)
class Span:
    """An interval as far as it is known [us]."""

    start_us: int | None = None
    end_us: int | None = None


def possible(left: Span, right: Span) -> frozenset[str]:
    """The relations in which left can still turn out to stand to right; one that is left is certain."""
    return _with_signs(
        _signs(left.start_us, right.start_us),
        _signs(left.start_us, right.end_us),
        _signs(left.end_us, right.start_us),
        _signs(left.end_us, right.end_us),
    )


def relations_named(names: Iterable[str]) -> frozenset[str]:
    """The relations of these names, in any case; `intersects` stands for nine.

    raises InvalidInput for a name that is none
    """
    found: frozenset[str] = frozenset()
    for name in names:
        relations = NAMES.get(name.lower())
        if relations is None:
            raise InvalidInput(
                f"{name!r} is no relation of two intervals",
                f"Write one or several of {', '.join(SIGNS)}, intersects, with | between them.",
            )
        found |= relations
    return found


def _signs(one_us: int | None, other_us: int | None) -> str:
    """How one moment may stand to another."""
    if one_us is None:
        return "<=>" if other_us is None else ">"
    if other_us is None or one_us < other_us:
        return "<"
    return "=" if one_us == other_us else ">"


@cache
def _with_signs(*signs: str) -> frozenset[str]:
    """The relations in which each pair of ends stands in one of these ways."""
    return frozenset(
        name
        for name, wanted in SIGNS.items()
        if all(sign in among for sign, among in zip(wanted, signs, strict=True))
    )
