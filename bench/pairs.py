"""What a query about pairs of tracks costs a batch, and what a late state costs with one.

Everybody walks without a pause, and the query asks who is within 2 m of whom. Of a late state three things
are told: the processor time of its writer, that of its correction by a worker beside, and how long other
batches take while such corrections go on.
"""

from __future__ import annotations

import time
from contextlib import closing

import numpy as np
import psycopg
from numpy.typing import NDArray
from semap_ingest.state_copy import COPY_STATES, copy_rows

from bench.crowd import Floor, batches, build_map, frame_stamps, walk
from bench.figure import Rows, figure
from bench.small_batches import cpu_ms
from bench.throughput import FIRST_US, FLOOR
from semap.store.database.connection import connect
from semap.timeline.stamp import to_datetime
from semap.worker.correcting import correcting

TRACKS = 1000
BATCHES = 90
WARM_UP = 15
ROUNDS = 5
NEAR_M = 2.0
CROWDS = {20: Floor(4, 3), 200: Floor(4, 3)}
LATE_EACH = 6
NEAR = (
    "insert into semap.continuous_query (map_id, name, predicate, subject_kind, object_kind, distance_m)"
    " values (%s, 'near', 'within_distance', 'track', 'track', %s)"
)
LATE_BY_US = 300_000
CORRECT = "select semap.correct_some()"
LATE = "insert into semap.track_state (track_id, stamp, x_m, y_m, z_m) values (%s, %s, %s, %s, 1)"


def measure(dsn: str) -> Rows:
    """A row for the crowd, and one for each size of crowd with late states."""
    return [_crowd(dsn), *(_late(dsn, tracks, floor) for tracks, floor in CROWDS.items())]


def _crowd(dsn: str) -> dict[str, object]:
    cpu: dict[bool, list[float]] = {False: [], True: []}
    places = walk(FLOOR, TRACKS, BATCHES, 0.0)
    for asked, found in cpu.items():
        with closing(connect(dsn)) as connection:
            ids = _map(connection, f"crowd {asked}", FLOOR, TRACKS, asked)
            for batch in batches(ids, places, FIRST_US):
                found.append(sent(connection, batch)[0])
    return {
        "what": f"a batch of {TRACKS:,} walking tracks",
        "cpu_ms": rounds(cpu[True]),
        "cpu_ms_without_query": rounds(cpu[False]),
    }


def _late(dsn: str, tracks: int, floor: Floor) -> dict[str, object]:
    writer, correction = [], []
    wall: dict[bool, list[float]] = {False: [], True: []}
    count = 4 * BATCHES
    with closing(connect(dsn)) as connection:
        ids = _map(connection, f"late {tracks}", floor, tracks, True)
        places = walk(floor, tracks, count, 0.0)
        frames, stamps_us = batches(ids, places, FIRST_US), frame_stamps(count, FIRST_US)

        def come_late(number: int) -> None:
            track = number % tracks
            x_m, y_m = places[number, track]
            stamp_us = int(stamps_us[number]) - LATE_BY_US - number
            connection.execute(LATE, [int(ids[track]), to_datetime(stamp_us), float(x_m) + 0.3, float(y_m)])

        for number, batch in enumerate(frames[: 2 * BATCHES]):
            wall[False].append(sent(connection, batch)[1])
            if number >= WARM_UP and number % LATE_EACH == 0:
                before = cpu_ms(connection)
                come_late(number)
                between = cpu_ms(connection)
                while connection.execute(CORRECT).fetchone() != (0,):
                    pass
                writer.append(between - before)
                correction.append(cpu_ms(connection) - between)
        with correcting(dsn):
            for number, batch in enumerate(frames[2 * BATCHES :], 2 * BATCHES):
                wall[True].append(sent(connection, batch)[1])
                if number % LATE_EACH == 0:
                    come_late(number)
    return {
        "what": f"a late state among {tracks} tracks",
        "writer_cpu_ms": rounds(writer, 0),
        "correction_cpu_ms": rounds(correction, 0),
        "batch_p99_ms": figure([float(np.percentile(wall[False], 99))], 1),
        "batch_p99_ms_beside_corrections": figure([float(np.percentile(wall[True], 99))], 1),
    }


def _map(
    connection: psycopg.Connection, name: str, floor: Floor, tracks: int, asked: bool
) -> NDArray[np.int64]:
    map_id, ids = build_map(connection, name, floor.rooms(), tracks)
    connection.execute("select semap.ensure_partitions(array[date '2026-01-01'])")
    if asked:
        connection.execute(NEAR, [map_id, NEAR_M])
    connection.execute("vacuum analyze semap.track_now")
    return ids


def sent(connection: psycopg.Connection, batch: object) -> tuple[float, float]:
    """Processor time of the server and time of a batch [ms]."""
    before_ms, started_s = cpu_ms(connection), time.perf_counter()
    with connection.cursor() as cursor:
        copy_rows(COPY_STATES, cursor, batch)  # type: ignore[arg-type]
    took_ms = 1e3 * (time.perf_counter() - started_s)
    return cpu_ms(connection) - before_ms, took_ms


def rounds(measured: list[float], skipped: int = WARM_UP) -> object:
    return figure((float(np.median(part)) for part in np.array_split(measured[skipped:], ROUNDS)), 1)
