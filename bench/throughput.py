"""States per second through the triggers, beside a bare COPY of the same rows.

The bare table has the same columns and nothing else: no key, no partitions, no constraint, no
trigger. Both commit every batch durably. Rounds of the two alternate.
"""

from __future__ import annotations

import time

import psycopg
from semap_ingest.replay import COPY_STATES
from semap_ingest.state_copy import COLUMNS

from bench.crowd import Floor, batches, build_map, walk
from bench.figure import figure
from semap.store.database import connect

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
        places = walk(FLOOR, TRACKS, (ROUNDS + 1) * FRAMES, pause_s)
        rates: dict[str, list[float]] = {"bare": [], "triggers": []}
        data = batches(track_ids, places, FIRST_US)
        _copy(connection, COPY_STATES, data[:FRAMES])
        connection.execute("vacuum analyze semap.track_now")
        before = _changes(connection)
        for number in range(1, ROUNDS + 1):
            some = data[number * FRAMES : (number + 1) * FRAMES]
            connection.execute("truncate bare")
            rates["bare"].append(_copy(connection, COPY_BARE, some))
            rates["triggers"].append(_copy(connection, COPY_STATES, some))
        changes = _changes(connection) - before
        connection.execute("drop table bare")
    ratios = [t / b for t, b in zip(rates["triggers"], rates["bare"], strict=True)]
    return {
        "crowd": name,
        "rooms": len(FLOOR.rooms()),
        "tracks": TRACKS,
        "batch": TRACKS,
        "changes_per_1000_states": round(1000 * changes / (ROUNDS * FRAMES * TRACKS), 1),
        "bare_copy_per_s": figure(rates["bare"]),
        "triggers_per_s": figure(rates["triggers"]),
        "ratio": figure(ratios, 3),
    }


def _copy(connection: psycopg.Connection, statement: str, data: list[bytes]) -> float:
    started_s = time.perf_counter()
    with connection.cursor() as cursor:
        for batch in data:
            with cursor.copy(statement) as copy:
                copy.write(batch)
    return len(data) * TRACKS / (time.perf_counter() - started_s)


def _changes(connection: psycopg.Connection) -> int:
    row = connection.execute("select count(*) from semap.relation_change").fetchone()
    return int(row[0]) if row else 0
