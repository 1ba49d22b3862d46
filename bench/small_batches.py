"""What a batch of a few tracks costs, sent at 15 Hz as a tracker does, beside a bare COPY of the same rows.

Few states leave nothing to share the fixed cost of a statement among, and between two frames the machine does
other things, so that nothing is in the processor's caches. Counted is the CPU time of the server's process
for each batch, by the kernel: with COPY (of frames: INSERT), triggers and commit. Batches of all tables take
turns.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from threading import Event as Signal
from typing import Any

import numpy as np
import psycopg
from numpy.typing import NDArray
from semap_ingest.state_copy import COPY_STATES, copy_rows
from semap_ingest.track_batch import send_batch

from bench.crowd import RATE_HZ, batches, build_map, framed, source_of, walk
from bench.figure import Rows, figure
from bench.throughput import BARE_TABLE, COPY_BARE, FIRST_US, FLOOR
from semap.store.database.connection import connect

TRACKS = (1, 20, 67)
ROUNDS = 5
FRAMES = 150
WARM_UP = 60
PAUSE_S = 5.0
DEBOUNCED = """
    update semap.continuous_query
    set enter_margin_m = 0.15, leave_margin_m = 0.15, enter_confirm = '0.3 s', leave_confirm = '0.3 s'
    where map_id = %s
"""


@dataclass
class Kept:
    """What was measured of one kind of table, batch by batch. Mutable.

    cpu_ms, wall_ms  of the server's process; from the COPY or INSERT to its commit
    """

    connection: psycopg.Connection
    write: Callable[[psycopg.Cursor, Any], None]
    batches: Sequence[object]
    cpu_ms: list[float] = field(default_factory=list)
    wall_ms: list[float] = field(default_factory=list)

    def send(self, number: int) -> None:
        before_ms = cpu_ms(self.connection)
        started_s = time.perf_counter()
        with self.connection.cursor() as cursor:
            self.write(cursor, self.batches[number])
        self.wall_ms.append(1e3 * (time.perf_counter() - started_s))
        Signal().wait(0.002)  # until the process sleeps again
        self.cpu_ms.append(cpu_ms(self.connection) - before_ms)


def measure(dsn: str) -> Rows:
    """One row for each number of tracks."""
    return [_measure(dsn, tracks) for tracks in TRACKS]


def _measure(dsn: str, tracks: int) -> dict[str, object]:
    count = WARM_UP + ROUNDS * FRAMES
    places = walk(FLOOR, tracks, count, PAUSE_S)
    tables = {
        "bare": _bare(dsn, tracks, places),
        "frames": _triggers(dsn, f"{tracks} tracks", places, in_frames=True),
        "rows": _triggers(dsn, f"{tracks} tracks, as rows", places),
        "debounced": _triggers(dsn, f"{tracks} tracks, debounced", places, in_frames=True, debounced=True),
    }
    for number in range(count):
        for table in tables.values():
            Signal().wait(1 / RATE_HZ / len(tables))
            table.send(number)
    row: dict[str, object] = {"tracks": tracks, "batches": ROUNDS * FRAMES}
    for name, table in tables.items():
        table.connection.close()
        row[f"{name}cpu_ms"] = figure(map(median, _rounds(table.cpu_ms)), 2)
        row[f"{name}_ms"] = figure(map(median, _rounds(table.wall_ms)), 2)
    return row


def _bare(dsn: str, tracks: int, places: NDArray[np.float64]) -> Kept:
    connection = connect(dsn)
    connection.execute("drop table if exists bare")
    connection.execute(BARE_TABLE)
    return Kept(connection, partial(copy_rows, COPY_BARE), batches(np.arange(tracks), places, FIRST_US))


def _triggers(
    dsn: str, name: str, places: NDArray[np.float64], *, in_frames: bool = False, debounced: bool = False
) -> Kept:
    connection = connect(dsn)
    map_id, track_ids = build_map(connection, name, FLOOR.rooms(), places.shape[1])
    if debounced:
        connection.execute(DEBOUNCED, [map_id])
    connection.execute("select semap.ensure_partitions(array[date '2026-01-01'])")
    connection.execute("vacuum analyze semap.track_now, semap.region")
    if in_frames:
        source_id = source_of(connection, track_ids)
        return Kept(connection, send_batch, framed(source_id, track_ids, places, FIRST_US))
    return Kept(connection, partial(copy_rows, COPY_STATES), batches(track_ids, places, FIRST_US))


def _rounds(values: Sequence[float]) -> list[Sequence[float]]:
    return [values[WARM_UP + number * FRAMES :][:FRAMES] for number in range(ROUNDS)]


def cpu_ms(connection: psycopg.Connection) -> float:
    """What the process at the other end has used of a processor so far."""
    used_ns, _, _ = Path(f"/proc/{connection.info.backend_pid}/schedstat").read_text().split()
    return int(used_ns) / 1e6
