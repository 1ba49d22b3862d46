"""States through one socket: how many, beside a bare COPY of the same rows, and how soon events come.

A client sends a frame as columns and goes on while up to 16 of them are without an answer. In the rate all
work is counted until the last answer: JSON, its checks, the triggers, a durable commit for each frame. The
clock of a delay starts when the client sends a frame, and stops when another client has the text of an event
of it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from threading import Event as Signal
from threading import Thread

import numpy as np
from numpy.typing import NDArray
from semap_ingest.state_copy import copy_rows
from semap_service.processes.port import free_port
from semap_service.processes.supervisor import Supervisor

from bench.crowd import RATE_HZ, batches, build_map, walk
from bench.figure import Rows, figure, percentiles
from bench.latency import FIRST_US, FLOOR, await_service, by_round, listen
from bench.throughput import BARE_TABLE, COPY_BARE
from semap.client import Client
from semap.store.database.connection import connect
from semap.timeline.stamp import rfc3339, to_datetime

TRACKS = (67, 1000)
ROUNDS = 5
ROUND_S = 8.0
FRAMES = 150
SOURCE = "socket"


@dataclass
class Sent:
    """When each frame was begun [s, monotonic], and how long after it was due [ms], by stamp [us]."""

    begun_s: dict[int, float] = field(default_factory=dict)
    late_ms: dict[int, float] = field(default_factory=dict)


def measure(dsn: str, round_s: float = ROUND_S, rounds: int = ROUNDS, frames: int = FRAMES) -> Rows:
    """A row for each number of tracks at 15 Hz; a round before the others warms up."""
    return [_measure(dsn, tracks, round_s, rounds, frames) for tracks in TRACKS]


def _measure(dsn: str, tracks: int, round_s: float, rounds: int, frames: int) -> dict[str, object]:
    name = f"bridges {tracks}"
    paced = round((rounds + 1) * round_s * RATE_HZ)
    with connect(dsn) as connection:
        build_map(connection, name, FLOOR.rooms(), 1)
        connection.execute("select semap.ensure_partitions(array[date '2026-01-02'])")
    places = walk(FLOOR, tracks, paced + rounds * frames, pause_s=5.0)
    port, sent = free_port(), Sent()
    with Supervisor(dsn) as supervisor:
        supervisor.start("work")
        supervisor.start("serve", "--port", str(port), "--without-tokens")
        await_service(port)
        url = f"http://127.0.0.1:{port}"
        received = asyncio.run(listen(port, name, lambda: _paced(url, name, places[:paced], sent)))
        rates = list(_rates(url, name, places[paced:].reshape(rounds, frames, tracks, 2), paced))
    delays_ms: list[list[float]] = [[] for _ in range(rounds + 1)]
    for stamp_us, at_s in received:
        round_ = min(int((stamp_us - FIRST_US) / 1e6 / round_s), rounds)
        delays_ms[round_].append((at_s - sent.begun_s[stamp_us]) * 1e3)
    bare = _bare(dsn, places[paced:].reshape(rounds, frames, tracks, 2))
    return {
        "tracks": tracks,
        "events": len(received),
        **percentiles(delays_ms[1:]),
        "late_p99_ms": percentiles(by_round(sent.late_ms, round_s, rounds)[1:])["p99_ms"],
        "socket_per_s": figure(rates),
        "bare_copy_per_s": figure(bare),
        "ratio": figure([rate / of for rate, of in zip(rates, bare, strict=True)], 3),
    }


def _frames(places: NDArray[np.float64], first: int) -> Iterator[tuple[int, dict[str, object]]]:
    """The stamp [us] and the columns of each frame of (frames, tracks, 2) places."""
    names = [f"person {number}" for number in range(places.shape[1])]
    for number, frame in enumerate(places, first):
        stamp_us = FIRST_US + round(number * 1e6 / RATE_HZ)
        yield (
            stamp_us,
            {
                "track": names,
                "stamp": rfc3339(to_datetime(stamp_us)),
                "x_m": frame[:, 0].round(3).tolist(),
                "y_m": frame[:, 1].round(3).tolist(),
                "z_m": 1.0,
            },
        )


def _paced(url: str, name: str, places: NDArray[np.float64], sent: Sent) -> list[Thread]:
    frames = list(_frames(places, 0))

    def write() -> None:
        started_s = time.monotonic() + 0.5
        with Client(url) as client, client.stream_states(name, SOURCE) as stream:
            for stamp_us, columns in frames:
                due_s = started_s + (stamp_us - FIRST_US) / 1e6
                Signal().wait(max(due_s - time.monotonic(), 0))
                sent.begun_s[stamp_us] = time.monotonic()
                sent.late_ms[stamp_us] = 1e3 * (sent.begun_s[stamp_us] - due_s)
                stream.send(columns)

    writer = Thread(target=write)
    writer.start()
    return [writer]


def _rates(url: str, name: str, rounds: NDArray[np.float64], first: int) -> Iterator[float]:
    """States per second, as fast as they are taken."""
    for number, places in enumerate(rounds):
        frames = list(_frames(places, first + number * len(places)))
        with Client(url) as client, client.stream_states(name, SOURCE) as stream:
            started_s = time.perf_counter()
            for _, columns in frames:
                stream.send(columns)
            stream.flush()
            yield places.shape[0] * places.shape[1] / (time.perf_counter() - started_s)


def _bare(dsn: str, rounds: NDArray[np.float64]) -> Sequence[float]:
    rates = []
    with connect(dsn) as connection, connection.cursor() as cursor:
        connection.execute("drop table if exists bare")
        connection.execute(BARE_TABLE)
        copy = partial(copy_rows, COPY_BARE, cursor)
        for places in rounds:
            rows = batches(np.arange(places.shape[1]), places, FIRST_US)
            started_s = time.perf_counter()
            for each in rows:
                copy(each)
            rates.append(places.shape[0] * places.shape[1] / (time.perf_counter() - started_s))
        connection.execute("drop table bare")
    return rates
