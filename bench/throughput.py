"""States per second, as track batches and as rows, beside a bare COPY of the same rows; and their room.

The bare table has the same columns and nothing else: no key, no partitions, no constraint, no
trigger. All commit every batch durably, with the relations that follow from it. Rounds take turns.

All work is counted: after each round all states are compacted, which the worker does beside the writer.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import psycopg
from psycopg.sql import SQL, Identifier
from semap_ingest.state_copy import COLUMNS, COPY_STATES, copy_rows
from semap_ingest.track_batch import send_batch

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
        source_id = source_of(connection, track_ids)
        as_rows = batches(track_ids, places, FIRST_US)
        as_batches = framed(source_id, track_ids, places, FIRST_US)
        rates: dict[str, list[float]] = {"bare": [], "batches": [], "rows": []}
        bytes_each: dict[str, list[float]] = {"bare": [], "hot": [], "compacted": []}
        _rate(connection, partial(copy_rows, COPY_STATES), as_rows[:FRAMES])
        _compact(connection, source_id)
        connection.execute("vacuum analyze semap.track_now")
        before = _changes(connection)
        for number in range(1, 2 * ROUNDS, 2):
            some, others = (slice(each * FRAMES, (each + 1) * FRAMES) for each in (number, number + 1))
            connection.execute("truncate bare, semap.state_chunk, semap.track_state")
            rates["bare"].append(_rate(connection, partial(copy_rows, COPY_BARE), as_rows[some]))
            bytes_each["bare"].append(_bytes(connection, "bare"))
            for kind, send, sent in (
                ("rows", partial(copy_rows, COPY_STATES), as_rows[some]),
                ("batches", send_batch, as_batches[others]),
            ):
                first_s = 1 / _rate(connection, send, sent)
                bytes_each["hot"].append(_bytes(connection, "semap.state_chunk"))
                rates[kind].append(1 / (first_s + _compact(connection, source_id)))
                bytes_each["compacted"].append(_bytes(connection, "semap.state_chunk"))
                connection.execute("truncate semap.state_chunk")
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
        "batches_per_s": figure(rates["batches"]),
        "ratio": figure(ratios["batches"], 3),
        "rows_per_s": figure(rates["rows"]),
        "ratio_of_rows": figure(ratios["rows"], 3),
        "bytes_of_a_row": figure(bytes_each["bare"], 1),
        "bytes_hot": figure(bytes_each["hot"], 1),
        "bytes_compacted": figure(bytes_each["compacted"], 1),
    }


def _compact(connection: psycopg.Connection, source_id: int) -> float:
    """What it takes for each state until nothing is left to do [s]."""
    started_s = time.perf_counter()
    connection.execute("select semap.compact_all(array[%s])", [source_id])
    return (time.perf_counter() - started_s) / (FRAMES * TRACKS)


def _bytes(connection: psycopg.Connection, table: str) -> float:
    """The room of a state, with all keys; partitions are counted, and rows that are dead are not."""
    connection.execute(SQL("vacuum full {}").format(Identifier(*table.split("."))))
    row = connection.execute(
        "select coalesce(sum(pg_total_relation_size(relid)), pg_total_relation_size(%(table)s))"
        " from pg_partition_tree(%(table)s) where isleaf",
        {"table": table},
    ).fetchone()
    return float(row[0]) / (FRAMES * TRACKS) if row else 0.0


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
