"""Records that wait until it is known where their sensor was.

A transform is often published after the record that needs it. Each source's records come out in the order
in which they came in, each with the matrix from its frame to the target frame, or as given up: nothing waits
for ever. How long a record has waited is event time: the newest of what each source said last, less the
record's own stamp. One that lies as far in the future of all that follows has a wrong stamp, and is given up,
too.
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
    """Anything seen in a frame at a stamp [us]."""

    @property
    def stamp_us(self) -> int: ...

    @property
    def frame(self) -> str: ...


R = TypeVar("R", bound=Record)


@dataclass(frozen=True, eq=False)
class Ready(Generic[R]):
    """target_T_frame  (4, 4), of the record's frame at its stamp"""

    source: str
    record: R
    target_T_frame: NDArray[np.float64]


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
    patience_us  how far the newest stamp may be from a record's own before the record is given up
    most         how many records of one source wait, even if time stands still; of more the first is given up
    """

    def __init__(
        self, buffer: TransformBuffer, target: str, patience_us: int = PATIENCE_US, most: int = MOST
    ) -> None:
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
        taken: list[tuple[int, Ready[R] | GivenUp[R]]] = []
        for source, queue in self._queues.items():
            while queue:
                record = queue[0].record
                found = self._buffer.lookup(self._target, record.frame, record.stamp_us)
                if isinstance(found, Missing):
                    is_late = abs(newest_us - record.stamp_us) > self._patience_us
                    if not (is_over or is_late or len(queue) > self._most):
                        break
                    self._given_up[source, found] += 1
                    taken.append((queue.popleft().arrival, GivenUp(source, record, found)))
                else:
                    taken.append((queue.popleft().arrival, Ready(source, record, found)))
        return [each for _, each in sorted(taken, key=lambda pair: pair[0])]
