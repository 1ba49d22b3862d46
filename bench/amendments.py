"""What it costs that a query follows amendments of tracks.

Everybody walks without a pause from room to room. Two tracks at a time are found to have been switched, some
time ago. Told is the processor time of a batch with such a query and without, before anybody was switched;
that of an amendment and its correction, by how far back it reaches; and that of the correction of each batch
from then on, in which the states of two tracks are read as one another's.
"""

from __future__ import annotations

from contextlib import closing

import numpy as np
import psycopg
from numpy.typing import NDArray

from bench.crowd import Floor, batches, build_map, frame_stamps, walk
from bench.figure import Rows
from bench.pairs import WARM_UP, rounds, sent
from bench.small_batches import cpu_ms
from bench.throughput import FIRST_US
from semap.store.database.connection import connect
from semap.timeline.stamp import to_datetime

SECOND_US = 1_000_000
FLOOR = Floor(4, 3)
TRACKS = (24, 200)
BACK_S = (1, 10)
BEFORE, AFTER = 180, 60
AMENDED = 5
FOLLOW = "update semap.continuous_query set follows_amendments = true where map_id = %s"
SWITCHED = (
    "insert into semap.track_amendment (track_id, other_track_id, kind, since, found)"
    " values (%s, %s, 'switched', %s, %s)"
)
CORRECT = "select semap.correct_some()"


def measure(dsn: str) -> Rows:
    """A row for each size of crowd."""
    return [_crowd(dsn, tracks) for tracks in TRACKS]


def _crowd(dsn: str, tracks: int) -> dict[str, object]:
    count = BEFORE + AFTER + AMENDED * len(BACK_S)
    places, stamps_us = walk(FLOOR, tracks, count, 0.0), frame_stamps(count, FIRST_US)
    batch: dict[bool, list[float]] = {False: [], True: []}
    amendment: dict[int, list[float]] = {back_s: [] for back_s in BACK_S}
    further = []
    with closing(connect(dsn)) as connection:
        ids = {follows: _map(connection, tracks, follows) for follows in batch}
        frames = list(zip(*(batches(ids[follows], places, FIRST_US) for follows in batch), strict=True))
        for pair_of_frames in frames[:BEFORE]:
            for found, frame in zip(batch.values(), pair_of_frames, strict=True):
                found.append(sent(connection, frame)[0])

        def amended(number: int, pair: int, back_s: int) -> float:
            """Processor time of an amendment of the n-th pair after a batch, until all is right."""
            found_us = int(stamps_us[number])
            told = [to_datetime(found_us - back_s * SECOND_US), to_datetime(found_us)]
            before = cpu_ms(connection)
            connection.execute(SWITCHED, [int(ids[True][2 * pair]), int(ids[True][2 * pair + 1]), *told])
            _correct(connection)
            return cpu_ms(connection) - before

        amended(BEFORE - 1, 0, BACK_S[0])
        for _, frame in frames[BEFORE : BEFORE + AFTER]:
            sent(connection, frame)
            before = cpu_ms(connection)
            _correct(connection)
            further.append(cpu_ms(connection) - before)
        for pair, back_s in enumerate(BACK_S * AMENDED, 1):
            number = BEFORE + AFTER + pair - 1
            sent(connection, frames[number][1])
            _correct(connection)
            amendment[back_s].append(amended(number, pair, back_s))
    return {
        "tracks": tracks,
        "batch_cpu_ms": rounds(batch[True]),
        "batch_cpu_ms_without": rounds(batch[False]),
        **{f"amendment_{back_s}_s_cpu_ms": rounds(found, 0) for back_s, found in amendment.items()},
        "further_batch_cpu_ms": rounds(further, WARM_UP),
    }


def _map(connection: psycopg.Connection, tracks: int, follows: bool) -> NDArray[np.int64]:
    """The ids of its tracks."""
    map_id, ids = build_map(connection, f"{tracks} tracks {follows}", FLOOR.rooms(), tracks)
    connection.execute("select semap.ensure_partitions(array[date '2026-01-01'])")
    if follows:
        connection.execute(FOLLOW, [map_id])
    connection.execute("vacuum analyze semap.track_now")
    return ids


def _correct(connection: psycopg.Connection) -> None:
    while connection.execute(CORRECT).fetchone() != (0,):
        pass
