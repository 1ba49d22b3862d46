"""Run all benchmarks: print a table and write bench/results.json.

python -m bench [throughput] [latency]
"""

from __future__ import annotations

import json
import platform
import shutil
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

from bench import latency, throughput
from semap.cluster import lease
from semap.store.schema import migrate

RESULTS = Path(__file__).parent / "results.json"
AIMS = {"throughput": "ratio_median at least 0.25", "latency": "p50_ms at most 10 at 1,000 states/s"}


def main(wanted: list[str]) -> None:
    """Measure on a server of the run's own, with semap's own settings."""
    results: dict[str, object] = {
        "measured_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {"processor": platform.machine(), "python": platform.python_version()},
    }
    folder = Path(tempfile.mkdtemp(prefix="semap-bench-"))
    folder.chmod(0o711)
    try:
        with lease(folder) as cluster:
            for name, run in (("throughput", _throughput), ("latency", _latency)):
                if not wanted or name in wanted:
                    cluster.create_database(name)
                    migrate(cluster.dsn(name))
                    rows = run(cluster.dsn(name))
                    print(f"\n{name} (aim: {AIMS[name]})")
                    _table(rows)
                    results[name] = rows
                    cluster.drop_database(name)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    RESULTS.write_text(json.dumps(results, indent=2) + "\n")
    print(
        f"\nwritten to {RESULTS.relative_to(Path.cwd()) if RESULTS.is_relative_to(Path.cwd()) else RESULTS}"
    )


def _throughput(dsn: str) -> list[dict[str, object]]:
    rounds, frames = throughput.ROUNDS, throughput.FRAMES
    print(f"throughput: {rounds} rounds of {frames} batches, bare COPY and triggers in turn ...")
    return throughput.measure(dsn)


def _latency(dsn: str) -> list[dict[str, object]]:
    print(f"latency: {latency.LENGTH_S:.0f} s through the triggers, the log, the worker and the service ...")
    return [latency.measure(dsn, rate) for rate in (1_000, 10_000)]


def _table(rows: list[dict[str, object]]) -> None:
    titles = list(rows[0])
    lines = [titles, *([str(row[title]) for title in titles] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(titles))]
    for line in lines:
        print("  " + "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))


if __name__ == "__main__":
    main(sys.argv[1:])
