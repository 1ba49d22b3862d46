"""Commands in processes of their own that need not import the libraries anew.

Of a command's second, nearly all is the import of libraries. A server that has imported them, and nothing of semap,
is forked for each call: all that is semap's own is still imported, run and ended as from a shell.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from multiprocessing import get_context
from pathlib import Path

LIBRARIES = [
    "fastapi", "geoalchemy2", "jsonschema", "numpy", "psycopg", "rich", "scipy.spatial", "shapely", "sqlalchemy",
    "sqlalchemy.dialects.postgresql.psycopg", "typer", "yaml",
]  # fmt: skip


def run_warm(
    arguments: Sequence[str], environment: Mapping[str, str], stdin: str | None, patience_s: float
) -> subprocess.CompletedProcess[str]:
    """What `semap` with these arguments would answer."""
    forking = get_context("forkserver")
    forking.set_forkserver_preload(LIBRARIES)
    with tempfile.TemporaryDirectory() as place:
        files = [Path(place) / name for name in ("in", "out", "error")]
        files[0].write_text(stdin or "")
        process = forking.Process(target=_run, args=(list(arguments), dict(environment), files))
        process.start()
        process.join(patience_s)
        if process.exitcode is None:
            process.kill()
            process.join()
            raise subprocess.TimeoutExpired(["semap", *arguments], patience_s)
        out, error = (file.read_text() for file in files[1:])
        return subprocess.CompletedProcess(["semap", *arguments], process.exitcode, out, error)


def _run(arguments: list[str], environment: dict[str, str], files: list[Path]) -> None:
    for descriptor, file in enumerate(files):
        opened = os.open(file, os.O_RDONLY if descriptor == 0 else os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(opened, descriptor)
        os.close(opened)
    sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115  multiprocessing has closed the first one
    os.environ.clear()
    os.environ.update(environment)
    sys.argv = ["semap", *arguments]
    from semap_service.cli import main  # noqa: PLC0415

    main()
