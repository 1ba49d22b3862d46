"""Run all benchmarks: print a table and write bench/results.json.

python -m bench [throughput] [latency] [abstractions] [operators] [solid] [rules] [recording]
"""

from __future__ import annotations

import json
import platform
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from bench import abstractions, latency, operators, recording, rules, solid, throughput
from semap.cluster import lease
from semap.store.schema import migrate

RESULTS = Path(__file__).parent / "results.json"

Rows = list[dict[str, object]]


@dataclass(frozen=True)
class Benchmark:
    """What it does, what it aims at, and the run on a migrated database of its own."""

    begins: str
    aim: str
    run: Callable[[str], Rows]


BENCHMARKS = {
    "throughput": Benchmark(
        f"{throughput.ROUNDS} rounds of {throughput.FRAMES} batches, bare COPY and triggers in turn",
        "ratio_median at least 0.25",
        throughput.measure,
    ),
    "latency": Benchmark(
        f"{latency.LENGTH_S:.0f} s through the triggers, the log, the worker and the service",
        "p50_ms at most 10 at 1,000 states/s",
        lambda dsn: [latency.measure(dsn, rate) for rate in (1_000, 10_000)],
    ),
    "abstractions": Benchmark(
        "all abstractions of meshes of a million triangles",
        "seconds at most 5, peak_rss_mb at most 2048",
        lambda _: abstractions.measure(),
    ),
    "operators": Benchmark("questions over 100,000 instances", "median_ms at most 10", operators.measure),
    "solid": Benchmark(
        "exact 3D predicates on pairs of meshes",
        "boxes apart 1 ms, surfaces apart 100 ms, touching 1 s, at 1,280 triangles",
        lambda dsn: solid.measure(dsn, 3),
    ),
    "rules": Benchmark(
        f"{rules.ROUNDS} rounds of {rules.ROWS:,} rows, the engine and Flink in turn; then memory",
        "semap's rate at least Flink's, the same matches, memory flat",
        lambda _: rules.measure(),
    ),
    "recording": Benchmark(
        "scans read from disk as values", "at least 20,000 scans/s", lambda _: recording.measure()
    ),
}


def main(wanted: list[str]) -> None:
    """Measure on a server of the run's own, with semap's own settings."""
    unknown = set(wanted) - set(BENCHMARKS)
    if unknown:
        sys.exit(f"There is no benchmark {', '.join(sorted(unknown))}: choose from {', '.join(BENCHMARKS)}.")
    results: dict[str, object] = {
        "measured_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {"processor": platform.machine(), "python": platform.python_version()},
    }
    folder = Path(tempfile.mkdtemp(prefix="semap-bench-"))
    folder.chmod(0o711)
    try:
        with lease(folder) as cluster:
            for name in wanted or BENCHMARKS:
                benchmark = BENCHMARKS[name]
                cluster.create_database(name)
                migrate(cluster.dsn(name))
                print(f"{name}: {benchmark.begins} ...", flush=True)
                rows = benchmark.run(cluster.dsn(name))
                print(f"\n{name} (aim: {benchmark.aim})")
                _table(rows)
                results[name] = rows
                cluster.drop_database(name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    RESULTS.write_text(json.dumps(results, indent=2) + "\n")
    print(
        f"\nwritten to {RESULTS.relative_to(Path.cwd()) if RESULTS.is_relative_to(Path.cwd()) else RESULTS}"
    )


def _table(rows: Rows) -> None:
    titles = list(dict.fromkeys(title for row in rows for title in row))
    lines = [titles, *([str(row.get(title, "")) for title in titles] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(titles))]
    for line in lines:
        print("  " + "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))


if __name__ == "__main__":
    main(sys.argv[1:])
