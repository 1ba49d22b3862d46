"""States per second through the triggers, as frames and as rows, beside a bare COPY of the same rows.

The bare table has the same columns and nothing else: no key, no partitions, no constraint, no
trigger. All commit every batch durably, with the relations that follow from it. Rounds take turns.

What is a frame at first becomes rows of track_state within seconds, beside the writer: what that takes is
measured after each round, and so is the rate if one process did both.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import psycopg
from semap_ingest.replay import COPY_STATES
from semap_ingest.state_copy import COLUMNS, copy_rows
from semap_ingest.state_frame import insert_frame

from bench.crowd import Floor, batches, build_map, framed, source_of, walk
from bench.figure import figure
from semap.store.database.connection import connect

BARE_TABLE = """
    create table bare (
      track_id bigint, stamp timestamptz, x_m float8, y_m float8, z_m float8, std_m real, is_last boolean)
"""
COPY_BARE = f"copy bare ({', '.join(COLUMNS)}) from stdin (format binary)"
ROUNDS = 5
FRAMES = 200
TRACKS = 1000
FLOOR = Floor(40, 25)
FIRST_US = 1_767_225_600_000_000
CROWDS = {"office (pauses up to 30 s)": 30.0, "marching (never pauses)": 0.0}


def measure(dsn: str) -> list[dict[str, object]]:
    """One row for each crowd: rates [states/s] of bare COPY and of the triggers, and their ratio."""
    return [_measure(dsn, name, pause_s) for name, pause_s in CROWDS.items()]


def _measure(dsn: str, name: str, pause_s: float) -> dict[str, object]:
    with connect(dsn) as connection:
        _, track_ids = build_map(connection, name, FLOOR.rooms(), TRACKS)
        connection.execute(BARE_TABLE)
        connection.execute("select semap.ensure_partitions(array[date '2026-01-01'])")
        places = walk(FLOOR, TRACKS, (2 * ROUNDS + 1) * FRAMES, pause_s)
        rates: dict[str, list[float]] = {"bare": [], "rows": [], "frames": [], "both": []}
        as_rows = batches(track_ids, places, FIRST_US)
        as_frames = framed(source_of(connection, track_ids), track_ids, places, FIRST_US)
        _rate(connection, partial(copy_rows, COPY_STATES), as_rows[:FRAMES])
        connection.execute("vacuum analyze semap.track_now")
        before = _changes(connection)
        later_us = []
        for number in range(1, 2 * ROUNDS, 2):
            some, others = (slice(each * FRAMES, (each + 1) * FRAMES) for each in (number, number + 1))
            connection.execute("truncate bare")
            rates["bare"].append(_rate(connection, partial(copy_rows, COPY_BARE), as_rows[some]))
            rates["rows"].append(_rate(connection, partial(copy_rows, COPY_STATES), as_rows[some]))
            rates["frames"].append(_rate(connection, insert_frame, as_frames[others]))
            later_us.append(_unfold_us(connection))
            rates["both"].append(1e6 / (1e6 / rates["frames"][-1] + later_us[-1]))
        changes = _changes(connection) - before
        connection.execute("drop table bare")
    ratios = {kind: [r / b for r, b in zip(of, rates["bare"], strict=True)] for kind, of in rates.items()}
    return {
        "crowd": name,
        "rooms": len(FLOOR.rooms()),
        "tracks": TRACKS,
        "batch": TRACKS,
        "changes_per_1000_states": round(1000 * changes / (2 * ROUNDS * FRAMES * TRACKS), 1),
        "bare_copy_per_s": figure(rates["bare"]),
        "frames_per_s": figure(rates["frames"]),
        "ratio": figure(ratios["frames"], 3),
        "rows_per_s": figure(rates["rows"]),
        "ratio_of_rows": figure(ratios["rows"], 3),
        "us_later_per_state": figure(later_us, 2),
        "ratio_with_later": figure(ratios["both"], 3),
    }


def _unfold_us(connection: psycopg.Connection) -> float:
    """What it takes for each state to become a row of track_state."""
    (before,) = connection.execute("select count(*) from semap.track_state").fetchone() or (0,)
    started_s = time.perf_counter()
    while connection.execute("select semap.unfold_frames()").fetchone() != (0,):
        pass
    seconds = time.perf_counter() - started_s
    (after,) = connection.execute("select count(*) from semap.track_state").fetchone() or (0,)
    return 1e6 * seconds / (after - before)


def _rate(
    connection: psycopg.Connection, send: Callable[[psycopg.Cursor, Any], None], batches: Sequence[object]
) -> float:
    started_s = time.perf_counter()
    with connection.cursor() as cursor:
        for batch in batches:
            send(cursor, batch)
    return len(batches) * TRACKS / (time.perf_counter() - started_s)


def _changes(connection: psycopg.Connection) -> int:
    row = connection.execute("select count(*) from semap.relation_change").fetchone()
    return int(row[0]) if row else 0
