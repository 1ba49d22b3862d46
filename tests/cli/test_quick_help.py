"""`semap --help` is there at once: nothing is imported that a command needs only when it runs."""

from __future__ import annotations

import json
import resource
import subprocess
import sys

MOST_S = 0.3
SLOW_TO_IMPORT = (
    "alembic", "fastapi", "httpx", "jinja2", "matplotlib", "numpy", "opentelemetry", "pandas", "prometheus_client",
    "psycopg", "pydantic", "rich", "scipy", "shapely", "sqlalchemy", "trimesh", "uvicorn", "yaml",
)  # fmt: skip


def test_help_takes_little_time() -> None:
    """The best of five, in time of the processor: what a clock shows on a machine that does nothing else."""
    took_s = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "semap_service", "--help"], capture_output=True, check=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        took_s.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert min(took_s) <= MOST_S, took_s


def test_help_imports_nothing_slow() -> None:
    ask = (
        "import json, sys; sys.argv = ['semap', '--help']; from semap_service.cli import commands\n"
        "try: commands()()\nexcept SystemExit: sys.stderr.write(json.dumps(sorted(sys.modules)))"
    )
    ran = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    assert set(SLOW_TO_IMPORT) & set(json.loads(ran.stderr)) == set()


def test_semap_itself_imports_nothing_slow() -> None:
    ask = "import json, sys, semap; sys.stdout.write(json.dumps(sorted(sys.modules)))"
    ran = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    assert set(SLOW_TO_IMPORT) & set(json.loads(ran.stdout)) == set()
