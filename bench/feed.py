"""Events at many WebSocket clients of which some never read: nobody who reads misses one, memory is bounded.

A writer commits 20 events every 20 ms, as the rule worker does. The clock starts before the commit and stops
when a client has the bytes of the frame that holds the event. Service, worker, PostgreSQL, writer and clients
share the machine.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from threading import Event as Signal
from threading import Thread
from uuid import uuid4

import httpx
import numpy as np
import psycopg
from numpy.typing import NDArray
from semap_service.processes.port import free_port
from semap_service.processes.supervisor import Supervisor

from bench.figure import once
from semap.store.database.connection import connect

READERS = 450
DEAF = 50
EVENTS_PER_S = 1000
PER_COMMIT = 20
LENGTH_S = 60.0
PROCESSES = 2
PATIENCE_S = 60.0
SAMPLE_S = 1.0


@dataclass
class Memory:
    """Of the service, second by second."""

    rss_mb: list[float] = field(default_factory=list)
    peak_mb: float = 0.0
    cpu_s: float = 0.0


def measure(dsn: str, length_s: float = LENGTH_S) -> list[dict[str, object]]:
    """The run without the deaf, and then with them."""
    with connect(dsn) as connection:
        connection.execute("insert into semap.map (name, uid) values ('office', gen_random_uuid())")
    return [_run(dsn, READERS + DEAF, 0, length_s), _run(dsn, READERS, DEAF, length_s)]


def _run(dsn: str, readers: int, deaf: int, length_s: float) -> dict[str, object]:
    port = free_port()
    count = round(length_s * EVENTS_PER_S / PER_COMMIT) * PER_COMMIT
    memory = Memory()
    with Supervisor(dsn) as supervisor, ExitStack() as stack, tempfile.TemporaryDirectory() as folder:
        supervisor.start("work")
        supervisor.start("serve", "--port", str(port), "--without-tokens")
        _await(lambda: httpx.get(f"http://127.0.0.1:{port}/ready").is_success)
        files = [Path(folder) / f"{number}.npy" for number in range(PROCESSES)]
        shares = [(readers // PROCESSES, deaf if number == 0 else 0) for number in range(PROCESSES)]
        clients = [
            stack.enter_context(_clients(port, *share, count, file))
            for share, file in zip(shares, files, strict=True)
        ]
        for client in clients:
            assert client.stdout is not None
            assert client.stdout.readline() == "ready\n"
        server = _listener(supervisor)
        stack.enter_context(_watched(server, memory))
        with connect(dsn) as connection:
            before = _numbers(connection)
            committed_s, took_s = _write(connection, count)
            after = _numbers(connection)
        summaries = [json.loads(client.stdout.readline()) for client in clients if client.stdout]
        arrivals = [np.load(file) for file in files]
        deaf_open = _open_sockets(port) - PROCESSES * (readers // PROCESSES)
    delays_ms = np.concatenate([_delays_ms(each, committed_s, before[1] + 1) for each in arrivals])
    received = sum(int((each[:, 2] - each[:, 1] + 1).sum()) for each in arrivals)
    p50, p99 = np.percentile(delays_ms, [50, 99])
    return {
        "readers": readers,
        "deaf": deaf,
        "events": after[0] - before[0],
        "events_per_s": once(count / took_s),
        "received": received,
        "missed": readers * count - received,
        "out_of_order": sum(each["broken"] for each in summaries),
        "told_too_slow": sum(each["told"] for each in summaries),
        "deaf_still_open": max(deaf_open, 0),
        "p50_ms": once(float(p50), 1),
        "p99_ms": once(float(p99), 1),
        "max_ms": once(float(delays_ms.max()), 1),
        "frames_per_s": once(sum(len(each) for each in arrivals) / took_s),
        "server_cores": once(memory.cpu_s / took_s, 2),
        "server_mb": [round(each) for each in memory.rss_mb[:: max(len(memory.rss_mb) // 6, 1)]],
        "server_peak_mb": once(memory.peak_mb),
    }


@contextmanager
def _clients(port: int, readers: int, deaf: int, count: int, file: Path) -> Iterator[subprocess.Popen[str]]:
    arguments = [str(each) for each in (port, readers, deaf, count, file)]
    process = subprocess.Popen(
        [sys.executable, "-m", "bench.feed_reader", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.communicate("\n", timeout=PATIENCE_S)


def _write(connection: psycopg.Connection, count: int) -> tuple[NDArray[np.float64], float]:
    """When each commit began [s, monotonic], and how long all took [s]."""
    row = connection.execute("select map_id from semap.map where name = 'office'").fetchone()
    assert row is not None
    commits = count // PER_COMMIT
    begun_s = np.empty(commits)
    tick_s = PER_COMMIT / EVENTS_PER_S
    started_s = time.monotonic()
    for number in range(commits):
        Signal().wait(max(started_s + number * tick_s - time.monotonic(), 0))
        written = json.dumps([_event(row[0]) for _ in range(PER_COMMIT)])
        with connection.transaction():
            connection.execute("select semap.add_events('rules', %s)", [written])
            begun_s[number] = time.monotonic()
    return begun_s, time.monotonic() - started_s


def _event(map_id: int) -> dict[str, object]:
    stamp = datetime.now(UTC).isoformat()
    return {
        "event_id": str(uuid4()),
        "map_id": map_id,
        "rule_name": "room_visits",
        "rule_version": 1,
        "type": "entered",
        "stamp": stamp,
        "since": stamp,
        "cause": "moved",
        "track_id": 3,
        "track_name": "person 3",
        "instance_id": 7,
        "instance_name": "Room07",
        "evidence": [{"uid": str(uuid4()), "variable": "", "source": "relation", "stamp": stamp}],
    }


def _delays_ms(
    arrivals: NDArray[np.float64], committed_s: NDArray[np.float64], first: int
) -> NDArray[np.float64]:
    """Of each event at each client, from the begin of its commit."""
    counts = (arrivals[:, 2] - arrivals[:, 1] + 1).astype(np.int64)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    numbers = np.repeat(arrivals[:, 1].astype(np.int64), counts) + within
    delays: NDArray[np.float64] = (
        np.repeat(arrivals[:, 3], counts) - committed_s[(numbers - first) // PER_COMMIT]
    )
    return delays * 1e3


def _numbers(connection: psycopg.Connection) -> tuple[int, int]:
    """How many events there are, and the number of the last, which is as many: there is no gap."""
    row = connection.execute("select count(*), coalesce(max(seq), 0) from semap.event").fetchone()
    assert row is not None
    assert row[0] == row[1]
    return row[0], row[1]


@contextmanager
def _watched(pid: int, memory: Memory) -> Iterator[None]:
    stop = Signal()
    begun_s = cpu_s(pid)

    def look() -> None:
        while not stop.wait(SAMPLE_S):
            status = Path(f"/proc/{pid}/status").read_text()
            read = {line.partition(":")[0]: line.partition(":")[2] for line in status.splitlines()}
            memory.rss_mb.append(int(read["VmRSS"].split()[0]) / 1024)
            memory.peak_mb = int(read["VmHWM"].split()[0]) / 1024
            memory.cpu_s = cpu_s(pid) - begun_s

    watching = Thread(target=look)
    watching.start()
    try:
        yield
    finally:
        stop.set()
        watching.join()


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _listener(supervisor: Supervisor) -> int:
    """The process of the service."""
    (process,) = (each for each in supervisor.processes if each.arguments[0] == "serve")
    assert process.popen is not None
    return process.popen.pid


def _open_sockets(port: int) -> int:
    """Connections of clients to a port of this machine that are established on the service's side."""
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    fields = [line.split() for line in lines]
    return sum(each[1].endswith(f":{port:04X}") and each[3] == "01" for each in fields)


def _await(happens: object) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        try:
            if happens():  # type: ignore[operator]
                return
        except httpx.TransportError:
            pass
        Signal().wait(0.1)
    raise TimeoutError("The service did not come up.")
