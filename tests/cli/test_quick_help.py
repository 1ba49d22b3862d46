"""`semap --help` is there at once: nothing is imported that a command needs only when it runs."""

from __future__ import annotations

import json
import subprocess
import sys

SLOW_TO_IMPORT = (
    "alembic", "fastapi", "filterpy", "httpx", "jinja2", "matplotlib", "numpy", "opentelemetry", "pandas",
    "prometheus_client", "psycopg", "pydantic", "rich", "scipy", "shapely", "sqlalchemy", "trimesh", "uvicorn", "yaml",
)  # fmt: skip


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
