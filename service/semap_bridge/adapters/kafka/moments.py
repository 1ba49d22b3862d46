"""States of one stamp are given on together: in two statements, each of them costs half as much again.

What is held back is behind the position, so that it is read again by who goes on from there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from semap_ingest.named_states import NO_STATES, NamedStates

from semap_bridge.adapter import Batch
from semap_bridge.adapters.kafka.decoding import Record

MOST = 10_000
"""So many states are held back at most."""


class Moments:
    """Mutable: the states of the newest stamp, of which more may come, and their records."""

    def __init__(self) -> None:
        self._states = NO_STATES
        self._records: list[Record] = []

    def begins(self) -> Mapping[int, int]:
        """The offset of the first record of each partition that is held back."""
        found: dict[int, int] = {}
        for each in self._records:
            found.setdefault(each.partition() or 0, each.offset() or 0)
        return found

    def take(self, records: Sequence[Record], batch: Batch, *, is_more: bool) -> Batch:
        """What of a batch, and of what was held back before it, is given on.

        records  that the batch was read from; where one has not just a state, nothing is held back
        is_more  there are further records, which are about to come
        """
        parts = [each for each in (self._states, batch.states) if len(each)]
        states = NamedStates.joined(parts) if parts else NO_STATES
        held = [*self._records, *records]
        end = len(states)
        if is_more and len(states) == len(held) <= MOST and not batch.objects and not batch.refused:
            others = np.flatnonzero(states.stamp_us != states.stamp_us[-1]) if held else np.empty(0, np.int64)
            end = int(others[-1]) + 1 if others.size else 0
        self._records = held[end:] if end < len(states) else []
        self._states = states.take(np.arange(end, len(states)))
        return replace(batch, states=states.take(np.arange(end)))
