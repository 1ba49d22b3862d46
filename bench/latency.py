"""Time from COPY to the event at a WebSocket client, with every process of semap in between.

A source is a tracker that follows up to 200 people at 15 Hz and sends each frame as it is made: a track
batch, one state of each of its tracks. At 1,000 states/s that is one source of 67 tracks, at
30,000 ten of 200, each with a connection of its own and its frames a little after those of the one before.
Frames are whole, so that each says how far its source is; an event waits for the next frames of the others.

The clock starts when the COPY of a frame does, and stops when the client has the text of an event of it. How
late a COPY began, since the one before was not done, is `late_p99_ms`: the rate is kept where that is small.

An event waits for two commits, that of the COPY and that of the worker, so the disk is measured beside it:
`commit_ms` is what one row takes that the first source commits to a table of its own after each second frame.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from threading import Event as Signal
from threading import Thread

import httpx
import numpy as np
import psycopg
import websockets
from numpy.typing import NDArray
from semap_ingest.track_batch import send_batch
from semap_service.processes.port import free_port
from semap_service.processes.supervisor import Supervisor

from bench.crowd import RATE_HZ, Floor, build_map, frame_stamps, framed, source_of, walk
from bench.figure import Rows, percentiles
from semap.store.database.connection import connect
from semap.timeline.stamp import parse_stamp

FIRST_US = parse_stamp("2026-01-02T00:00:00Z")
RATES = (1_000, 10_000, 30_000)
TRACKS_AT_MOST = 200
ROUNDS = 5
ROUND_S = 8.0
PATIENCE_S = 120.0
FLOOR = Floor(40, 25)


@dataclass
class Sent:
    """When each batch was begun [s, monotonic], and how long after it was due [ms], by stamp [us].

    commit_ms  what the commit of one row took after it
    """

    begun_s: dict[int, float] = field(default_factory=dict)
    late_ms: dict[int, float] = field(default_factory=dict)
    commit_ms: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Source:
    """Tracks whose states come together, so long after those of the first source.

    places  (frames, tracks, 2) [m]
    """

    source_id: int
    track_ids: NDArray[np.int64]
    places: NDArray[np.float64]
    after_us: int

    @cached_property
    def frames(self) -> list[tuple[int, Sequence[object]]]:
        """The stamp [us] and the row of each."""
        stamps_us = frame_stamps(len(self.places), FIRST_US + self.after_us)
        rows = framed(self.source_id, self.track_ids, self.places, int(stamps_us[0]))
        return list(zip(stamps_us.tolist(), rows, strict=True))


def measure(dsn: str, rates: Sequence[int] = RATES, round_s: float = ROUND_S, rounds: int = ROUNDS) -> Rows:
    """A row for each rate of states, each on a map of its own; a round before the others warms up."""
    return [_measure(dsn, rate, round_s, rounds) for rate in rates]


def _measure(dsn: str, states_per_s: int, round_s: float, rounds: int) -> dict[str, object]:
    name = f"latency {states_per_s}"
    with connect(dsn) as connection:
        sources = _sources(connection, name, states_per_s, round((rounds + 1) * round_s * RATE_HZ))
        connection.execute("select semap.ensure_partitions(array[date '2026-01-02'])")
        connection.execute("vacuum analyze semap.track_now")
        connection.execute("create table if not exists commit_alone (number integer)")
        connection.execute("grant insert on commit_alone to semap_ingest")
    port = free_port()
    with Supervisor(dsn) as supervisor:
        supervisor.start("work")
        supervisor.start("serve", "--port", str(port), "--without-tokens")
        await_service(port)
        sent = Sent()
        received = asyncio.run(listen(port, name, lambda: _writers(dsn, sources, sent)))
    with connect(dsn) as connection:
        (logged,) = connection.execute(
            "select count(*) from semap.event join semap.map m using (map_id) where m.name = %s", [name]
        ).fetchone() or (0,)
    delays_ms: list[list[float]] = [[] for _ in range(rounds + 1)]
    for stamp_us, at_s in received:
        delays_ms[_round(stamp_us, round_s, rounds)].append((at_s - sent.begun_s[stamp_us]) * 1e3)
    late_ms, commit_ms = (by_round(each, round_s, rounds) for each in (sent.late_ms, sent.commit_ms))
    commits = percentiles(commit_ms[1:])
    return {
        "states_per_s": round(sum(len(each.track_ids) for each in sources) * RATE_HZ),
        "sources": len(sources),
        "batch": len(sources[0].track_ids),
        "events": len(received),
        "events_in_the_log": logged,
        **percentiles(delays_ms[1:]),
        "late_p99_ms": percentiles(late_ms[1:])["p99_ms"],
        "commit_p50_ms": commits["p50_ms"],
        "commit_p99_ms": commits["p99_ms"],
    }


def by_round(values: Mapping[int, float], round_s: float, rounds: int) -> list[list[float]]:
    found: list[list[float]] = [[] for _ in range(rounds + 1)]
    for stamp_us, value in values.items():
        found[_round(stamp_us, round_s, rounds)].append(value)
    return found


def _round(stamp_us: int, round_s: float, last: int) -> int:
    """What other sources send after the last frame of the first is of the last round."""
    return min(int((stamp_us - FIRST_US) / 1e6 / round_s), last)


def _sources(connection: psycopg.Connection, name: str, states_per_s: int, frames: int) -> list[Source]:
    tracks = round(states_per_s / RATE_HZ)
    count = -(-tracks // TRACKS_AT_MOST)
    per_source = -(-tracks // count)
    _, track_ids = build_map(connection, name, FLOOR.rooms(), count * per_source, per_source)
    places = walk(FLOOR, count * per_source, frames, pause_s=5.0)
    return [
        Source(source_of(connection, ids), ids, own, round(number * 1e6 / RATE_HZ / count))
        for number, (ids, own) in enumerate(
            zip(np.split(track_ids, count), np.split(places, count, axis=1), strict=True)
        )
    ]


def await_service(port: int) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        try:
            if httpx.get(f"http://127.0.0.1:{port}/health").status_code == 200:
                return
        except httpx.TransportError:
            Signal().wait(0.1)
    raise TimeoutError("The service did not come up.")


def _writers(dsn: str, sources: Sequence[Source], sent: Sent) -> list[Thread]:
    frames = sum(len(source.frames) for source in sources)  # made now
    print(f"  {frames:,} batches", flush=True)
    started_s = time.monotonic() + 0.5
    writers = [Thread(target=_write, args=(dsn, source, started_s, sent)) for source in sources]
    for writer in writers:
        writer.start()
    return writers


def _write(dsn: str, source: Source, started_s: float, sent: Sent) -> None:
    with connect(dsn, "semap_ingest") as connection, connection.cursor() as cursor:
        for number, (stamp_us, row) in enumerate(source.frames):
            due_s = started_s + (stamp_us - FIRST_US) / 1e6
            Signal().wait(max(due_s - time.monotonic(), 0))
            begun_s = time.monotonic()
            sent.begun_s[stamp_us] = begun_s
            sent.late_ms[stamp_us] = 1e3 * (begun_s - due_s)
            send_batch(cursor, row)
            if source.after_us == 0 and number % 2 == 0:
                done_s = time.monotonic()
                cursor.execute("insert into commit_alone values (%s)", [number], prepare=True)
                sent.commit_ms[stamp_us] = 1e3 * (time.monotonic() - done_s)


async def listen(port: int, name: str, write: Callable[[], list[Thread]]) -> list[tuple[int, float]]:
    """Stamp [us] and time of arrival [s, monotonic] of every event until the writers are done."""
    received: list[tuple[int, float]] = []
    async with websockets.connect(
        f"ws://127.0.0.1:{port}/events/feed?map={name.replace(' ', '%20')}"
    ) as socket:
        hello = json.loads(await socket.recv())
        assert hello["type"] == "hello"
        writers = write()
        while True:
            try:
                message = await asyncio.wait_for(socket.recv(), 2.0)
            except TimeoutError:
                if not any(writer.is_alive() for writer in writers):
                    return received
                continue
            at_s = time.monotonic()
            document = json.loads(message)
            if document["type"] == "events":
                received += [(parse_stamp(event["stamp"]), at_s) for event in document["events"]]
