"""The cost of a state in several cases, whose rounds take turns: what else the machine does meets all."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray
from semap_ingest.state_copy import COPY_STATES, copy_rows, pack_states

from bench.crowd import frame_stamps
from bench.figure import Rows, figure

BATCH = 1000
SETTLE = """
    vacuum analyze semap.region, semap.region_cell, semap.region_edge, semap.track, semap.track_now,
                   semap.state_chunk
"""


copy_states = partial(copy_rows, COPY_STATES)


@dataclass(frozen=True)
class Case:
    """What is to be compared, ready to take in states.

    row      what the table says of it
    batches  for as many rounds as are measured and one more
    send     what sends a batch, and of how many states it is
    """

    row: dict[str, object]
    connection: psycopg.Connection
    batches: Iterator[Any]
    per_round: int
    send: Callable[[psycopg.Cursor, Any], None] = copy_states
    states: int = BATCH

    def feed(self) -> list[float]:
        """Seconds of each batch of the next round."""
        seconds = []
        with self.connection.cursor() as cursor:
            for batch in islice(self.batches, self.per_round):
                started_s = time.perf_counter()
                self.send(cursor, batch)
                seconds.append(time.perf_counter() - started_s)
        return seconds

    def us(self, seconds: Sequence[float]) -> float:
        """What a state took of these batches."""
        return 1e6 * sum(seconds) / (self.states * len(seconds))

    def changes(self) -> int:
        (count,) = self.connection.execute("select count(*) from semap.relation_change").fetchone() or (0,)
        return int(count)


def thousands(track_ids: NDArray[np.int64], places: NDArray[np.float64], first_us: int) -> Iterator[bytes]:
    """Batches of 1,000 states out of (frames, tracks, 2) places [m]: parts of a frame, or several frames."""
    frames, tracks, _ = places.shape
    stamps_us = np.repeat(frame_stamps(frames, first_us), tracks)
    ids, flat = np.tile(track_ids, frames), places.reshape(-1, 2)
    for start in range(0, frames * tracks - BATCH + 1, BATCH):
        rows = slice(start, start + BATCH)
        yield pack_states(
            ids[rows], stamps_us[rows], flat[rows, 0], flat[rows, 1],
            np.full(BATCH, 1.0), np.full(BATCH, 0.05), np.zeros(BATCH, dtype=np.bool_),
        )  # fmt: skip


def compare(cases: Sequence[Case], rounds: int) -> Rows:
    """A row for each case, compared with the first; one more round warms up."""
    for case in cases:
        case.connection.execute(SETTLE)
        case.feed()
        case.connection.execute("vacuum analyze semap.track_now")
    cases[0].connection.execute("checkpoint")
    before = [case.changes() for case in cases]
    turns = [[case.feed() for case in cases] for _ in range(rounds)]
    made = [case.changes() - count for case, count in zip(cases, before, strict=True)]
    return [
        {
            **case.row,
            "us_per_state": figure((case.us(turn[number]) for turn in turns), 2),
            "us_in_the_quietest_fifth": figure((case.us(_quietest(turn[number])) for turn in turns), 2),
            "times_the_first": figure((case.us(turn[number]) / cases[0].us(turn[0]) for turn in turns), 2),
            "changes_per_1000_states": round(
                1000 * made[number] / (rounds * case.per_round * case.states), 1
            ),
        }
        for number, case in enumerate(cases)
    ]


def _quietest(seconds: Sequence[float]) -> list[float]:
    return sorted(seconds)[: max(1, len(seconds) // 5)]
