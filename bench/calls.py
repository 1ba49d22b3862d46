"""Processor time of single calls that hostile or large input could make long, of help and of a scrape."""

from __future__ import annotations

import asyncio
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import httpx
import numpy as np
from semap_ingest.laser.pairing import pair_legs
from semap_ingest.lines.segments import find_lines
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.scan import Scan
from semap_service.operations.redaction import redacted
from semap_service.serving.app import create_app

from bench.figure import Rows, figure
from semap.cql2.value import like
from semap.errors import InvalidInput
from semap.query_text import declaration_of
from semap.store.database import connect

ROUNDS = 5
LEGS = 2000
SECRETS = ("a-", "a.", "a:", "a", "password=", "password='", "semap_", "bearer ", "a://", "a://b:", "@:")
NO_QUERIES = (
    "select " + "(" * 19_000,
    "select " + "a." * 9_000 + "b from track t, room r",
    "select 1" + "+1" * 9_000,
    "select 1 from track t, room r where " + "r.name = 'x' or " * 1_100 + "true",
)
FILLED = """
    insert into semap.map (name) values ('full');
    insert into semap.source (map_id, name)
      select map_id, 's' || n from semap.map, generate_series(1, 3000) n;
    insert into semap.source_count (source_id) select source_id from semap.source;
    insert into semap.webhook (url, cursor, created_by)
      select 'https://e.example', 0, 'me' from generate_series(1, 50);
    insert into semap.webhook_dead_letter (webhook_id, seq, event_id, map, type, body, attempts, error)
      select webhook_id, n, gen_random_uuid(), 'full', 'x', '', 1, ''
      from semap.webhook, generate_series(1, 400) n;
"""


def measure(dsn: str) -> Rows:
    """A row for each call."""
    calls: dict[str, Callable[[], object]] = {
        f"{LEGS:,} legs in one heap": _heap,
        "lines of a scan": _scanned,
        "redaction of 64,000 characters that look like secrets": lambda: [
            redacted(part * (64_000 // len(part))) for part in SECRETS
        ],
        "patterns of LIKE that fit late or never": _fit,
        "texts that are no queries": _read,
        "semap --help": lambda: subprocess.run(
            [sys.executable, "-m", "semap_service", "--help"], capture_output=True, check=True
        ),
    }
    rows = [{"call": name, "cpu_ms": figure(_rounds(call), 2)} for name, call in calls.items()]
    with connect(dsn) as connection:
        connection.execute(FILLED)
    with _scraping(dsn) as scrape:
        rows.append({"call": "a scrape of 3,000 sources", "cpu_ms": figure(_rounds(scrape), 2)})
    return rows


def _rounds(call: Callable[[], object]) -> list[float]:
    """Milliseconds of this process and of those that it waited for; the first round warms up."""
    took_ms = []
    for _ in range(ROUNDS + 1):
        begun_s = _cpu_s()
        call()
        took_ms.append(1e3 * (_cpu_s() - begun_s))
    return took_ms[1:]


def _cpu_s() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _heap() -> None:
    places_m = np.random.default_rng(2).uniform(0, 3, (LEGS, 2))
    spread = np.tile(np.eye(2) * 1e-4, (LEGS, 1, 1))
    each = [np.full(LEGS, value) for value in (0.9, 0.12, 8)]
    pair_legs(LegClusters(0, "laser", places_m, spread, *each), np.ones(LEGS, bool))


def _scanned() -> None:
    """A square room, 811 beams with noise."""
    angles = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 811)
    noise_m = np.random.default_rng(0).normal(0, 0.015, angles.shape)
    ranges_m = 4 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles))) + noise_m
    step_rad = float(angles[1] - angles[0])
    find_lines(Scan(1, "laser", float(angles[0]), step_rad, 0.05, 25.0, ranges_m.astype(np.float32)))


def _fit() -> None:
    like("%a" * 12 + "%b")("a" * 200)
    like("%a" * 1000 + "%")("a" * 100_000)
    like("%" * 8_000)("a" * 100_000)


def _read() -> None:
    for text in NO_QUERIES:
        try:
            declaration_of("q", text, ["Room"])
        except InvalidInput:
            continue
        raise RuntimeError(f"This was understood: {text[:60]}")


@contextmanager
def _scraping(dsn: str) -> Iterator[Callable[[], None]]:
    app = create_app(dsn, without_tokens=True)
    client = httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://127.0.0.1")

    async def scrape() -> None:
        (await client.get("/metrics")).raise_for_status()

    with asyncio.Runner() as runner:
        serving = app.router.lifespan_context(app)
        runner.run(serving.__aenter__())
        try:
            yield lambda: runner.run(scrape())
        finally:
            runner.run(client.aclose())
            runner.run(serving.__aexit__(None, None, None))
