"""What it costs to show moving people to the Foxglove app: 50 tracks at 15 Hz.

The bridge is a process of its own; its processor time is that of all of its threads. A client has
subscribed to all of its topics, and counts what comes. The clock of a delay starts when the COPY of
a frame is begun, and stops when the client has a scene with its stamp; the bridge looks 15 times a
second, so that half of 67 ms are waiting.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from struct import unpack_from
from threading import Event as Signal
from threading import Thread

import numpy as np
import psycopg
from semap_ingest.state_copy import COPY_STATES, copy_rows
from semap_service.processes.port import free_port
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from bench.crowd import RATE_HZ, Floor, batches, build_map, frame_stamps, walk
from bench.feed import cpu_s
from bench.figure import Rows, figure, percentiles
from bench.latency import FIRST_US
from semap.store.database.connection import connect as connect_database

TRACKS = 50
ROUNDS = 5
ROUND_S = 8.0
FLOOR = Floor(10, 5)
PEOPLE = "/semap/people"
CONFIG = "map: shown\nbridges:\n  - name: app\n    kind: foxglove\n    port: {port}\n"


def measure(dsn: str, round_s: float = ROUND_S, rounds: int = ROUNDS) -> Rows:
    """One row; a round before the others warms up."""
    frames = round((rounds + 1) * round_s * RATE_HZ)
    with connect_database(dsn) as connection:
        _, track_ids = build_map(connection, "shown", FLOOR.rooms(), TRACKS)
        connection.execute("select semap.ensure_partitions(array[date '2026-01-02'])")
        first, *rows = batches(track_ids, walk(FLOOR, TRACKS, frames + 1, pause_s=5.0), FIRST_US)
        stamps_us = frame_stamps(frames + 1, FIRST_US)[1:].tolist()
        with _bridge(dsn) as (pid, port), _client(port) as seen:
            _write(connection, first)
            while not seen:
                Signal().wait(0.1)
            begun_s, cores = {}, []
            per_round = round(round_s * RATE_HZ)
            started_s = time.monotonic()
            for number, (stamp_us, data) in enumerate(zip(stamps_us, rows, strict=True)):
                if number % per_round == 0:
                    cores.append(cpu_s(pid))
                Signal().wait(max(started_s + number / RATE_HZ - time.monotonic(), 0))
                begun_s[stamp_us] = time.monotonic()
                _write(connection, data)
            cores.append(cpu_s(pid))
            Signal().wait(1.0)
    delays_ms: list[list[float]] = [[] for _ in range(rounds + 1)]
    for stamp_us, at_s in seen:
        if stamp_us in begun_s:
            delays_ms[stamps_us.index(stamp_us) // per_round].append((at_s - begun_s[stamp_us]) * 1e3)
    return [
        {
            "tracks": TRACKS,
            "scenes_per_s": figure([len(each) / round_s for each in delays_ms[1:]], 1),
            "percent_of_a_core": figure(100 * np.diff(cores)[1:] / round_s, 1),
            **percentiles(delays_ms[1:]),
        }
    ]


def _write(connection: psycopg.Connection, data: bytes) -> None:
    with connection.cursor() as cursor:
        copy_rows(COPY_STATES, cursor, data)


@contextmanager
def _bridge(dsn: str) -> Iterator[tuple[int, int]]:
    """Its process, and its port."""
    port = free_port()
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "bridges.yaml"
        config.write_text(CONFIG.format(port=port))
        process = subprocess.Popen(
            [sys.executable, "-m", "semap_service", "bridge", str(config)],
            env={**os.environ, "SEMAP_DSN": dsn},
            stderr=subprocess.DEVNULL,
        )
        try:
            yield process.pid, port
        finally:
            process.terminate()
            process.wait()


@contextmanager
def _client(port: int) -> Iterator[list[tuple[int, float]]]:
    """The stamps [us] of scenes of people, each with when it came [s, monotonic]; it has all topics."""
    seen: list[tuple[int, float]] = []
    with _connected(port) as socket:
        topics: dict[str, int] = {}
        while PEOPLE not in topics:
            said = json.loads(socket.recv())
            topics |= {each["topic"]: each["id"] for each in said.get("channels", ())}
        wanted = [{"id": number, "channelId": number} for number in topics.values()]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

        def hear() -> None:
            try:
                for message in socket:
                    if isinstance(message, bytes):
                        _, number, log_time_ns = unpack_from("<BIQ", message)
                        if number == topics[PEOPLE]:
                            seen.append((log_time_ns // 1000, time.monotonic()))
            except ConnectionClosed:
                pass

        thread = Thread(target=hear)
        thread.start()
        yield seen
        socket.close()
        thread.join()


def _connected(port: int) -> ClientConnection:
    while True:
        try:
            return connect(f"ws://127.0.0.1:{port}", subprotocols=["foxglove.sdk.v1"], proxy=None)
        except OSError:
            Signal().wait(0.1)
