"""The moment that is asked about: as long as it was given exactly."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Moment:
    """Both ends included [us]. Given to the second it is all of that second, to the millisecond likewise."""

    from_us: int
    until_us: int

    @staticmethod
    def at(at_us: int) -> Moment:
        length_us = next(each for each in (1_000_000, 1_000, 1) if at_us % each == 0)
        return Moment(at_us, at_us + length_us - 1)

    def has(self, stamp_us: int) -> bool:
        return self.from_us <= stamp_us <= self.until_us

    def meets(self, begin_us: float, end_us: float) -> bool:
        """Whether any of it lies in a span."""
        return begin_us <= self.until_us and self.from_us <= end_us

    def away_us(self, stamp_us: int) -> int:
        """How far a stamp is from it."""
        return max(self.from_us - stamp_us, stamp_us - self.until_us, 0)
