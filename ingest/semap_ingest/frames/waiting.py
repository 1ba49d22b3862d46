"""Records that wait until it is known where their sensor was.

A transform is often published after the record that needs it. Each source's records come out in the order
in which they came in, each with the matrix from its frame to the target frame, or as given up. How long a
record has waited is event time: the newest of what each source said last, less the record's own stamp. One
that lies as far in the future of all that follows has a wrong stamp, and is given up, too.

Live, nothing waits for ever. In a file a transform may come much later than what needs it: there a record
that is newer than the newest transform waits for the next one, however long that takes.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from semap_ingest.frames.transform_buffer import Missing, TransformBuffer

PATIENCE_US = 500_000
MOST = 1000


class Record(Protocol):
    """Anything seen in a frame from a stamp to another one [us]."""

    @property
    def stamp_us(self) -> int: ...

    @property
    def last_us(self) -> int: ...

    @property
    def frame(self) -> str: ...


R = TypeVar("R", bound=Record)


@dataclass(frozen=True, eq=False)
class Ready(Generic[R]):
    """target_T_frame  (4, 4), of the record's frame at its stamp

    target_T_last  the same when it ended; None where that never became known
    """

    source: str
    record: R
    target_T_frame: NDArray[np.float64]
    target_T_last: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class GivenUp(Generic[R]):
    """A record whose place did not become known in time, and what was missing to the last."""

    source: str
    record: R
    why: Missing


@dataclass(frozen=True, eq=False)
class _Waiting(Generic[R]):
    """arrival  counts the records of all sources"""

    arrival: int
    record: R


class WaitingRecords(Generic[R]):
    """Mutable: records go in by `put`; `take` gives those whose wait is over. The buffer is filled by others.

    target       the frame that matrices lead to
    patience_us  how far the newest stamp may be from a record's own before the record is given up; None:
                 without end for those that are newer than the newest transform, PATIENCE_US for the others
    most         how many records of one source wait, even if time stands still; of more the first is given up
    held_us      the oldest stamp of a record that is newer than the newest transform; None: there is none
    """

    def __init__(
        self, buffer: TransformBuffer, target: str, patience_us: int | None = PATIENCE_US, most: int = MOST
    ) -> None:
        self.held_us: int | None = None
        self._buffer = buffer
        self._target = target
        self._patience_us = patience_us
        self._most = most
        self._queues: dict[str, deque[_Waiting[R]]] = {}
        self._last_us: dict[str, int] = {}
        self._arrivals = 0
        self._given_up: Counter[tuple[str, Missing]] = Counter()

    @property
    def given_up(self) -> Mapping[tuple[str, Missing], int]:
        """How many records of each source, by what was missing."""
        return dict(self._given_up)

    @property
    def newest_us(self) -> int:
        """The newest end of a record that waits; 0 where none does."""
        return max((each.record.last_us for queue in self._queues.values() for each in queue), default=0)

    def __len__(self) -> int:
        return sum(len(queue) for queue in self._queues.values())

    def put(self, source: str, record: R) -> None:
        self._queues.setdefault(source, deque()).append(_Waiting(self._arrivals, record))
        self._arrivals += 1
        self._last_us[source] = record.stamp_us

    def take(self) -> list[Ready[R] | GivenUp[R]]:
        """Those whose wait is over, in the order in which they came in."""
        return self._taken(is_over=False)

    def flush(self) -> list[Ready[R] | GivenUp[R]]:
        """All that are left, for no transform will come any more."""
        return self._taken(is_over=True)

    def _taken(self, is_over: bool) -> list[Ready[R] | GivenUp[R]]:
        newest_us = max(self._last_us.values(), default=0)
        held: list[int] = []
        taken: list[tuple[int, Ready[R] | GivenUp[R]]] = []
        for source, queue in self._queues.items():
            while queue:
                record = queue[0].record
                first = self._buffer.lookup(self._target, record.frame, record.stamp_us)
                last = first
                if record.last_us > record.stamp_us:
                    last = self._buffer.lookup(self._target, record.frame, record.last_us)
                missing = next((each for each in (first, last) if isinstance(each, Missing)), None)
                is_due = missing is None or self._is_due(missing, newest_us - record.stamp_us, len(queue))
                if not (is_due or is_over):
                    held += [record.stamp_us] if missing is Missing.NOT_YET else []
                    break
                arrival = queue.popleft().arrival
                if isinstance(first, Missing):
                    self._given_up[source, first] += 1
                    taken.append((arrival, GivenUp(source, record, first)))
                else:
                    known = None if isinstance(last, Missing) else last
                    taken.append((arrival, Ready(source, record, first, known)))
        self.held_us = min(held, default=None)
        self._buffer.needed_us = self.held_us
        return [each for _, each in sorted(taken, key=lambda pair: pair[0])]

    def _is_due(self, missing: Missing, waited_us: int, in_queue: int) -> bool:
        """Whether a record is given up that has waited so long."""
        if self._patience_us is None and missing is Missing.NOT_YET:
            return False
        patience_us = PATIENCE_US if self._patience_us is None else self._patience_us
        return abs(waited_us) > patience_us or in_queue > self._most
