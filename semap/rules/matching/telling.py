"""What is told of how attempts end: a match as one, or each of its rows, and those that bind no row."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from hashlib import sha1
from typing import Any, Protocol

from semap.rules.bound import NO_VARIABLE, Bound
from semap.rules.finish import Finish
from semap.rules.matching.attempt import Ending, first_row, path
from semap.rules.pattern import Excluded
from semap.rules.program import Match


class Teller(Protocol):
    """What the endings of a step become."""

    def one(self, bound: Bound) -> tuple[Any, ...]:
        """Of a match that ends with the row that was taken."""
        ...

    def all(self, ends: list[Ending]) -> tuple[Any, ...]:
        """Of all that a step ended."""
        ...


class Raw:
    """The endings themselves."""

    def one(self, bound: Bound) -> tuple[Ending, ...]:
        return (Ending(bound.row.stamp_us, first_row(bound), bound),)

    def all(self, ends: list[Ending]) -> tuple[Ending, ...]:
        return tuple(ends)


@dataclass(frozen=True)
class Emits:
    """The event of each way in which an attempt ends, and of a row that is in no match; None: none."""

    match: str | None = None
    timeout: str | None = None
    empty: str | None = None
    unmatched: str | None = None


@dataclass(frozen=True)
class Telling:
    """Measures matches, and drops those that `finish` drops.

    each_row  whether each row of a match is told, measured by the rows up to it
    """

    emits: Emits
    finish: Finish
    each_row: bool = False
    _types: dict[bool, str | None] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_types", {True: self.emits.match, False: self.emits.timeout})

    def one(self, bound: Bound) -> tuple[Match, ...]:
        event_type, stamp_us = self._types[True], bound.row.stamp_us
        if self.each_row or bound.variable == NO_VARIABLE:
            return tuple(self.told(Ending(stamp_us, bound.row, bound)))
        if event_type is None or (said := self.finish(bound, stamp_us)) is None:
            return ()
        return (_match(event_type, stamp_us, bound, said),)

    def all(self, ends: list[Ending]) -> tuple[Match, ...]:
        return self.numbered([(0, end) for end in ends])

    def numbered(self, ends: list[tuple[int, Ending]]) -> tuple[Match, ...]:
        """Of endings, each with the number of its match in the partition."""
        if len(ends) > 1:
            ends.sort(key=lambda pair: (pair[1].stamp_us, pair[1].first.order))
        return tuple(match for number, end in ends for match in self.told(end, number))

    def told(self, end: Ending, number: int = 0) -> Iterator[Match]:
        bound = end.bound
        if bound.variable == NO_VARIABLE:
            nothing = Bound(NO_VARIABLE, bound.row.saying({}))
            said = self.finish(nothing, end.stamp_us, nothing, number) if self.emits.empty else None
            if self.emits.empty is not None and said is not None:
                rows = ((NO_VARIABLE, bound.row),)
                yield Match(self.emits.empty, end.stamp_us, rows, *said, identity=NO_MATCH)
            return
        event_type = self._types[end.is_match]
        if event_type is None or (said := self.finish(bound, end.stamp_us, bound, number)) is None:
            return
        if self.each_row and end.is_match:
            yield from self._row_by_row(event_type, bound, number, said[1])
        else:
            yield _match(event_type, end.stamp_us, bound, said)

    def _row_by_row(
        self, event_type: str, whole: Bound, number: int, confidence: float | None
    ) -> Iterator[Match]:
        chain = [*whole.latest_first()][::-1]
        of_match = sha1("|".join(each.row.uid for each in chain).encode(), usedforsecurity=False).hexdigest()
        for place, bound in enumerate(chain):
            stamp_us = bound.row.stamp_us
            said = (
                None if isinstance(bound.variable, Excluded) else self.finish(bound, stamp_us, whole, number)
            )
            if said is not None:
                rows = ((bound.variable, bound.row),)
                identity = f"{of_match}|{place}"
                yield Match(event_type, stamp_us, rows, said[0], confidence, identity)


UNMATCHED = "unmatched"
NO_MATCH = "()"
"""In the identity of an event at a row that a match of one row may have too."""


def _match(event_type: str, stamp_us: int, bound: Bound, said: tuple[Any, Any]) -> Match:
    rows = path(bound)
    told = _told(rows)
    if len(told) == len(rows):
        return Match(event_type, stamp_us, rows, *said)
    identity = "|".join(row.uid for variable, row in rows if isinstance(variable, Excluded))
    return Match(event_type, stamp_us, told, *said, identity=identity)


def _told(rows: Sequence[tuple[str, Any]]) -> tuple[tuple[str, Any], ...]:
    """The rows without those that are excluded; where all are, the last."""
    return tuple([each for each in rows if type(each[0]) is not Excluded]) or tuple(rows[-1:])
