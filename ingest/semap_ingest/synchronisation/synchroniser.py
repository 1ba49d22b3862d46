"""Pairs of records of two sources by event time, each given out as soon as no better one can come.

What comes out   Every record that is added comes out exactly once: in a pair, alone, or refused. Pairs
    and those alone come in the order of event time (a pair at the earlier of its two stamps), so in order
    for each source.
Which pairs      Those that `matching.partners` finds in the complete sequences: the smallest gap first,
    of two equal ones the earlier; never more than the tolerance; no two that cross. They do not depend on
    the order in which records of different sources arrive.
When             At the first moment at which no future could change it, where a future is anything that
    keeps to the minimum periods: a source sends nothing before its last stamp and its minimum period, as
    in the approximate-time policy of ROS's message_filters (inter-message lower bound). `outlook.settled`
    decides it.
A silent source  is not waited for by more than `max_delay_us` of event time: once the other source has
    come to a stamp, it is taken to send nothing more that is older than that stamp less the delay.
A broken promise A record sooner than the minimum period, or later than the delay, is still welcome if
    nothing at or after its stamp was given out; pairs are then those of what was known when they were
    given out.
Refused          out_of_order: not after the last stamp of its own source. too_late: not after the
    watermark. stray: ahead of everything by more than `max_jump_us`, and no second record agreed with it
    (`clock_jump`). A clock that is set back makes all that follows out of order until it has caught up:
    begin a new synchroniser if that is meant. `refused` counts each.

No clock and no I/O: event time alone moves it.
"""

from __future__ import annotations

from bisect import insort
from collections import Counter
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar, cast

from semap.errors import InvalidInput
from semap_ingest.synchronisation.clock_jump import ClockJumps
from semap_ingest.synchronisation.matching import Record, order_of
from semap_ingest.synchronisation.outlook import Outlook, settled

NEVER_US = -(2**63)
A = TypeVar("A")
B = TypeVar("B")
Reason = Literal["out_of_order", "too_late", "stray"]


@dataclass(frozen=True)
class SourceTiming:
    """min_period_us  no two records of the source are closer than this; 0 where nothing is known"""

    min_period_us: int


@dataclass(frozen=True)
class Matched(Generic[A, B]):
    a_us: int
    a: A
    b_us: int
    b: B


@dataclass(frozen=True)
class AloneA(Generic[A]):
    stamp_us: int
    item: A


@dataclass(frozen=True)
class AloneB(Generic[B]):
    stamp_us: int
    item: B


@dataclass(frozen=True)
class Refused(Generic[A, B]):
    stamp_us: int
    side: str
    item: A | B
    reason: Reason


Output = Matched[A, B] | AloneA[A] | AloneB[B] | Refused[A, B]


class Synchroniser(Generic[A, B]):
    """Mutable: what waits for a partner, and how far both sources have come.

    tolerance_us  the greatest gap of a pair
    max_delay_us  event time for which a silent source is waited for
    max_jump_us   a lone record farther ahead than this is not believed
    refused       how many records were refused, by reason
    raises        InvalidInput for a negative duration, or a jump that is not longer than the minimum periods
    """

    def __init__(
        self,
        a: SourceTiming,
        b: SourceTiming,
        tolerance_us: int,
        max_delay_us: int,
        max_jump_us: int = 10_000_000,
    ) -> None:
        _check(a, b, tolerance_us, max_delay_us, max_jump_us)
        self.refused: Counter[Reason] = Counter()
        self._period_us: dict[str, int] = {"a": max(1, a.min_period_us), "b": max(1, b.min_period_us)}
        self._tolerance_us = tolerance_us
        self._max_delay_us = max_delay_us
        self._jumps = ClockJumps(max_jump_us)
        self._last_us: dict[str, int] = {"a": NEVER_US, "b": NEVER_US}
        self._frontier_us: dict[str, int] = {"a": NEVER_US, "b": NEVER_US}
        self._pending: list[Record] = []

    @property
    def watermark_us(self) -> int:
        """No output with a stamp at or before it is to come any more; NEVER_US as long as nothing is certain.

        The next stamp can be given out, if the minimum periods are kept.
        """
        first_us = min(self._frontier_us.values())
        if self._pending:
            first_us = min(first_us, self._pending[0].stamp_us)
        return max(NEVER_US, first_us - 1)

    def add_a(self, stamp_us: int, item: A) -> tuple[Output[A, B], ...]:
        """What is final now that this record of the source a has come."""
        return self._add(Record(int(stamp_us), "a", item))

    def add_b(self, stamp_us: int, item: B) -> tuple[Output[A, B], ...]:
        """What is final now that this record of the source b has come."""
        return self._add(Record(int(stamp_us), "b", item))

    def pass_to(self, stamp_us: int) -> tuple[Output[A, B], ...]:
        """What is final now that neither source sends anything before this stamp any more."""
        if stamp_us <= min(self._frontier_us.values()):
            return ()
        for side, frontier_us in self._frontier_us.items():
            self._frontier_us[side] = max(frontier_us, stamp_us)
        return self._settled()

    def flush(self) -> tuple[Output[A, B], ...]:
        """All that waits: nothing more is to come up to the latest stamp of both sources.

        A source may go on after that stamp.
        """
        astray = tuple(self._refuse(record, "stray") for record in self._jumps.give_up())
        latest_us = max(self._last_us.values())
        if latest_us > NEVER_US:
            for side in self._frontier_us:
                self._frontier_us[side] = max(self._frontier_us[side], latest_us + 1)
        never = Outlook(latest_us + self._tolerance_us + 1, 1)
        return (*astray, *self._give_out(settled(self._pending, never, never, self._tolerance_us)))

    def _add(self, record: Record) -> tuple[Output[A, B], ...]:
        in_step, astray = self._jumps.pass_on(record)
        out = [self._refuse(stray, "stray") for stray in astray]
        return (*out, *(output for each in in_step for output in self._take_in(each)))

    def _take_in(self, record: Record) -> tuple[Output[A, B], ...]:
        stamp_us, side, _ = record
        if stamp_us <= self._last_us[side]:
            return (self._refuse(record, "out_of_order"),)
        if stamp_us <= self.watermark_us:
            return (self._refuse(record, "too_late"),)
        other = "b" if side == "a" else "a"
        self._last_us[side] = stamp_us
        insort(self._pending, record, key=order_of)
        self._frontier_us[side] = max(self._frontier_us[side], stamp_us + self._period_us[side])
        self._frontier_us[other] = max(self._frontier_us[other], stamp_us - self._max_delay_us)
        return self._settled()

    def _settled(self) -> tuple[Output[A, B], ...]:
        a = Outlook(self._frontier_us["a"], self._period_us["a"])
        b = Outlook(self._frontier_us["b"], self._period_us["b"])
        return self._give_out(settled(self._pending, a, b, self._tolerance_us))

    def _give_out(self, partner: list[int | None]) -> tuple[Output[A, B], ...]:
        out: list[Output[A, B]] = []
        for place, other in enumerate(partner):
            record = self._pending[place]
            if other is None and record.side == "a":
                out.append(AloneA(record.stamp_us, cast(A, record.item)))
            elif other is None:
                out.append(AloneB(record.stamp_us, cast(B, record.item)))
            elif other > place:
                a, b = sorted((record, self._pending[other]), key=_side_of)
                out.append(Matched(a.stamp_us, cast(A, a.item), b.stamp_us, cast(B, b.item)))
        del self._pending[: len(partner)]
        return tuple(out)

    def _refuse(self, record: Record, reason: Reason) -> Refused[A, B]:
        self.refused[reason] += 1
        return Refused(record.stamp_us, record.side, cast("A | B", record.item), reason)


def _side_of(record: Record) -> str:
    return record.side


def _check(a: SourceTiming, b: SourceTiming, tolerance_us: int, max_delay_us: int, max_jump_us: int) -> None:
    durations = {
        "the minimum period of a": a.min_period_us,
        "the minimum period of b": b.min_period_us,
        "tolerance_us": tolerance_us,
        "max_delay_us": max_delay_us,
    }
    for name, duration_us in durations.items():
        if duration_us < 0:
            raise InvalidInput(
                f"{name} is {duration_us} us.", "Give a duration of 0 microseconds or more.", "synchroniser"
            )
    if max_jump_us <= max(a.min_period_us, b.min_period_us):
        raise InvalidInput(
            f"max_jump_us is {max_jump_us} us, not more than the minimum periods.",
            "Give a jump of several periods, so that each source can keep in step with itself.",
            "synchroniser",
        )
