"""Time from COPY to the event at a WebSocket client, with every process of semap in between.

A writer commits a batch every 20 ms, so that the states come at the wanted rate; each batch carries
states of people who walk between rooms. The clock starts before the COPY of the batch that holds the
state and stops when the client has the event's text.
"""

from __future__ import annotations

import asyncio
import json
import time
from dataclasses import dataclass, field
from threading import Event as Signal
from threading import Thread

import httpx
import numpy as np
import websockets
from numpy.typing import NDArray
from semap_ingest.replay import COPY_STATES
from semap_ingest.state_copy import pack_states
from semap_service.port import free_port
from semap_service.supervisor import Supervisor

from bench.crowd import Floor, build_map, walk
from semap.store.database import connect
from semap.timeline.stamp import parse_stamp

FIRST_US = parse_stamp("2026-01-02T00:00:00Z")
TICK_S = 0.02
TRACKS = 1000
LENGTH_S = 20.0
PATIENCE_S = 30.0


@dataclass
class Sent:
    """When each stamp's batch was begun [s, monotonic], by stamp [us]."""

    begun_s: dict[int, float] = field(default_factory=dict)


def measure(dsn: str, states_per_s: int) -> dict[str, object]:
    """Percentiles [ms] of the time from COPY to client at a rate of states."""
    name = f"latency {states_per_s}"
    per_batch = round(states_per_s * TICK_S)
    frames = round(LENGTH_S / TICK_S)
    with connect(dsn) as connection:
        _, track_ids = build_map(connection, name, Floor(40, 25).rooms(), TRACKS)
        connection.execute("select semap.ensure_partitions(array[date '2026-01-02'])")
    places = walk(Floor(40, 25), TRACKS, -(-frames * per_batch // TRACKS) + 1, pause_s=5.0).reshape(-1, 2)
    port = free_port()
    with Supervisor(dsn) as supervisor:
        supervisor.start("work")
        supervisor.start("serve", "--port", str(port), "--without-tokens")
        _await_service(port)
        sent = Sent()
        write = Thread(target=_write, args=(dsn, track_ids, places, per_batch, frames, sent))
        received = asyncio.run(_listen(port, name, write))
    delays_ms = np.array([(at_s - sent.begun_s[stamp_us]) * 1e3 for stamp_us, at_s in received])
    with connect(dsn) as connection:
        row = connection.execute(
            "select count(*) from semap.event join semap.map m using (map_id) where m.name = %s", [name]
        ).fetchone()
    p50, p90, p99 = np.percentile(delays_ms, [50, 90, 99])
    return {
        "states_per_s": states_per_s,
        "events": len(delays_ms),
        "events_in_the_log": row[0] if row else 0,
        "p50_ms": round(float(p50), 2),
        "p90_ms": round(float(p90), 2),
        "p99_ms": round(float(p99), 2),
        "max_ms": round(float(delays_ms.max()), 2),
    }


def _await_service(port: int) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        try:
            if httpx.get(f"http://127.0.0.1:{port}/health").status_code == 200:
                return
        except httpx.TransportError:
            Signal().wait(0.1)
    raise TimeoutError("The service did not come up.")


def _write(
    dsn: str,
    track_ids: NDArray[np.int64],
    places: NDArray[np.float64],
    per_batch: int,
    frames: int,
    sent: Sent,
) -> None:
    tracks = len(track_ids)
    started_s = time.monotonic()
    with connect(dsn, "semap_ingest") as connection, connection.cursor() as cursor:
        for frame in range(frames):
            rows = np.arange(frame * per_batch, (frame + 1) * per_batch)
            stamp_us = FIRST_US + round(frame * TICK_S * 1e6)
            data = pack_states(
                track_ids[rows % tracks], stamp_us + rows // tracks, places[rows, 0], places[rows, 1],
                np.full(per_batch, 1.0), np.full(per_batch, 0.05), np.zeros(per_batch, dtype=np.bool_),
            )  # fmt: skip
            Signal().wait(max(started_s + frame * TICK_S - time.monotonic(), 0))
            begun_s = time.monotonic()
            sent.begun_s.update((int(stamp), begun_s) for stamp in np.unique(stamp_us + rows // tracks))
            with cursor.copy(COPY_STATES) as copy:
                copy.write(data)


async def _listen(port: int, name: str, write: Thread) -> list[tuple[int, float]]:
    """Stamp [us] and time of arrival [s, monotonic] of every event until the writer is done."""
    received: list[tuple[int, float]] = []
    async with websockets.connect(
        f"ws://127.0.0.1:{port}/events/feed?map={name.replace(' ', '%20')}"
    ) as socket:
        hello = json.loads(await socket.recv())
        assert hello["type"] == "hello"
        write.start()
        while True:
            try:
                message = await asyncio.wait_for(socket.recv(), 2.0)
            except TimeoutError:
                if not write.is_alive():
                    return received
                continue
            at_s = time.monotonic()
            document = json.loads(message)
            if document["type"] == "events":
                received += [(parse_stamp(event["stamp"]), at_s) for event in document["events"]]
