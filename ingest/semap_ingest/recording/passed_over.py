"""What a recording holds and semap cannot use: counted and told, never fatal."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum


class Why(Enum):
    """Why something was passed over."""

    UNDECODABLE = "its bytes or its contents cannot be used"
    BAD_STAMP = "its stamp is no time"
    OTHER_CLASS = "it is a detection of something that is not a person"
    NOT_SEEN = "its tracker does not see the person at the moment"


@dataclass(frozen=True)
class Flaw:
    """What is wrong with one message, or with one part of it."""

    why: Why
    said: str


class Unusable(Exception):
    """Stops the decoding of a message; never leaves the reader."""

    def __init__(self, said: str, why: Why = Why.UNDECODABLE) -> None:
        super().__init__(said)
        self.flaw = Flaw(why, said)


@dataclass(frozen=True)
class PassedOver:
    """How often a topic had that flaw; `example` is what was wrong the first time."""

    topic: str
    why: Why
    count: int
    example: str


class Tally:
    """Flaws by topic and kind, in the order in which they were met."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, Why]] = Counter()
        self._examples: dict[tuple[str, Why], str] = {}

    def add(self, topic: str, flaw: Flaw) -> None:
        self._counts[topic, flaw.why] += 1
        self._examples.setdefault((topic, flaw.why), flaw.said)

    def rows(self) -> tuple[PassedOver, ...]:
        return tuple(
            PassedOver(topic, why, count, self._examples[topic, why])
            for (topic, why), count in self._counts.items()
        )
