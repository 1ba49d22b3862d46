"""How long a request can hold the event loop of the service, in which time nobody else is answered.

A heartbeat in the service's own loop measures the longest time between two of its beats. The requests that
`bench.hostile` makes of /openapi.json are sent some after another, those with files beside one another, as
other processes read them. Where the loop was held for long meanwhile, each is sent alone and again, and the
shortest of its times counts, since the machine does other work as well.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from http.client import HTTPConnection, HTTPException
from itertools import groupby, islice
from typing import Any

import httpx
from semap_service.access.limits import LIMITS
from semap_service.processes.port import free_port
from semap_service.serving.app import create_app
from semap_service.serving.uvicorn_server import serve as run
from starlette.types import ASGIApp, Receive, Scope, Send

from bench.figure import once
from bench.hostile import Attack, attacks
from semap.store.database.connection import connect

BEAT_S = 0.001
ASKED_AT = "/longest-hold"
GOAL_MS = 50.0
AGAIN_ABOVE_MS = 25.0
TIMES = 3
IN_A_ROW = 16
FILES_AT_ONCE = 4
BODY_BYTES = 1_000_000
TIMEOUT_S = 60.0
READY_S = 300.0
SHOWN = 25

FURNISHED = (
    "insert into semap.map (name, uid) values ('office', gen_random_uuid())",
    """insert into semap.event (seq, event_id, map_id, rule_name, rule_version, type, stamp, since, key)
       select n, gen_random_uuid(), map_id, 'r', 1, 'entered', to_timestamp(n), to_timestamp(n),
              jsonb_build_object('who', repeat('x', 200))
       from semap.map, generate_series(1, 20000) n""",
    "update semap.progress set event_seq = 20000",
)


class Watched:
    """The service, with a heartbeat in its loop whose longest pause is told at ASKED_AT, and forgotten."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._longest_s = 0.0
        self._beating: asyncio.Task[None] | None = None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self._beating is None:
            self._beating = asyncio.create_task(self._beat())
        if scope["type"] != "http" or scope["path"] != ASKED_AT:
            await self._app(scope, receive, send)
            return
        told, self._longest_s = f"{1e3 * self._longest_s:.3f}".encode(), 0.0
        await send(
            {
                "type": "http.response.start",
                "status": 200,
                "headers": [(b"content-length", b"%d" % len(told))],
            }
        )
        await send({"type": "http.response.body", "body": told})

    async def _beat(self) -> None:
        last_s, last_cpu_s = time.perf_counter(), time.process_time()
        while True:
            await asyncio.sleep(BEAT_S)
            now_s, now_cpu_s = time.perf_counter(), time.process_time()
            # Where the machine does other work, the time of all of the service's threads says what they took.
            held_s = min(now_s - last_s - BEAT_S, now_cpu_s - last_cpu_s)
            self._longest_s = max(self._longest_s, held_s)
            last_s, last_cpu_s = now_s, now_cpu_s


def serve(dsn: str, port: int) -> None:
    """The service as it runs for users, but for the rate of requests."""
    app = create_app(dsn, without_tokens=True, limits=replace(LIMITS, rate_per_s=1e6))
    app.openapi()
    run(Watched(app), "127.0.0.1", port)


def measure(dsn: str, body_bytes: int = BODY_BYTES) -> list[dict[str, object]]:
    """The longest hold of each operation, longest first."""
    with connect(dsn) as connection:
        for statement in FURNISHED:
            connection.execute(statement)
    port = free_port()
    process = subprocess.Popen([sys.executable, "-m", "bench.loop_holds", dsn, str(port)])
    try:
        holds = _walk(port, body_bytes)
    finally:
        process.terminate()
        process.wait()
    worst = sorted(holds.items(), key=lambda each: -each[1][0])
    return [
        {"operation": name, "sent": sent, "by": means, "hold_ms": once(hold_ms, 1)}
        for name, (hold_ms, means, sent) in worst[:SHOWN]
    ]


def _walk(port: int, body_bytes: int) -> dict[str, tuple[float, str, int]]:
    """By operation: the longest hold, what caused it, and how many requests were sent."""
    base = f"http://127.0.0.1:{port}"
    _await_ready(base)
    first_ms = _hold_of(port, Attack("get_openapi", "the first time", "GET", "/openapi.json", {}))
    holds: dict[str, tuple[float, str, int]] = defaultdict(lambda: (0.0, "", 0))
    holds["get_openapi"] = (first_ms, "the first time", 1)
    described: dict[str, Any] = httpx.get(f"{base}/openapi.json", timeout=TIMEOUT_S).json()
    for (operation, _), alike in groupby(
        attacks(described, body_bytes), key=lambda attack: (attack.operation, attack.is_file)
    ):
        while row := list(islice(alike, IN_A_ROW)):
            hold_ms, means = _longest_of(port, row)
            longest_ms, by, sent = holds[operation]
            longest = (hold_ms, means) if hold_ms > longest_ms else (longest_ms, by)
            holds[operation] = (*longest, sent + len(row))
    return dict(holds)


def _longest_of(port: int, row: Sequence[Attack]) -> tuple[float, str]:
    """The longest hold of some requests [ms], and what caused it."""
    together_ms = _hold_of(port, *row)
    if together_ms <= AGAIN_ABOVE_MS:
        return together_ms, row[0].means if len(row) == 1 else f"{row[0].means} to {row[-1].means}"
    longest = (0.0, "")
    for attack in row:
        hold_ms = _hold_of(port, attack)
        for _ in range(TIMES - 1):
            if hold_ms > AGAIN_ABOVE_MS:
                hold_ms = min(hold_ms, _hold_of(port, attack))
        if hold_ms > GOAL_MS:
            print(f"  {hold_ms:8.1f} ms  {attack.operation}  {attack.means}", flush=True)
        longest = max(longest, (hold_ms, attack.means))
    return longest


def _hold_of(port: int, *row: Attack) -> float:
    """How long requests held the loop [ms]."""
    _ask(port, "GET", ASKED_AT)
    with ThreadPoolExecutor(FILES_AT_ONCE if row[0].is_file else 1) as senders:
        list(senders.map(partial(_send, port), row))
    return float(_ask(port, "GET", ASKED_AT))


def _send(port: int, attack: Attack) -> None:
    asking = HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_S)
    try:
        asking.putrequest(attack.method, attack.target, skip_accept_encoding=True)
        for name, value in attack.headers.items():
            asking.putheader(name, value.encode("latin-1"))
        asking.putheader("Content-Length", str(len(attack.body)))
        asking.endheaders(attack.body)
        asking.getresponse().read()
    except (OSError, HTTPException):
        pass  # the service may hang up on what it does not want to read to its end
    finally:
        asking.close()


def _ask(port: int, method: str, target: str) -> bytes:
    asking = HTTPConnection("127.0.0.1", port, timeout=TIMEOUT_S)
    try:
        asking.request(method, target)
        return asking.getresponse().read()
    finally:
        asking.close()


def _await_ready(base: str) -> None:
    deadline_s = time.monotonic() + READY_S
    while True:
        try:
            httpx.get(f"{base}/health")
            return
        except httpx.TransportError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(0.1)


if __name__ == "__main__":
    serve(sys.argv[1], int(sys.argv[2]))
