"""Rules on Apache Flink: the job (`semap/flink/job.py`) in an interpreter of Flink's, with its checkpoints.

The job runs in a cluster inside of its own process and takes up where the newest checkpoint of its folder
was. Its workers get a copy of the package `semap`, of which they need the rules and nothing of a database.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import semap
from semap.errors import InvalidInput

WHERE = "import os, pyflink, shapely, yaml; print(os.path.dirname(pyflink.__file__))"
MODE = "_python_worker_execution_mode"
"""Else the client runs its workers inside of itself, where they share one lock and end it when they die."""


@dataclass(frozen=True)
class Job:
    """What is to be run, and with what.

    python       an interpreter that has PyFlink, shapely and PyYAML
    connector    the JAR flink-sql-connector-kafka
    checkpoints  the folder that keeps them
    settings     of Flink, which come before those that are set here
    """

    servers: str
    prefix: str
    python: Path
    connector: Path
    checkpoints: Path
    parallelism: int = 1
    settings: Sequence[str] = field(default=())

    def newest(self) -> Path | None:
        """The newest checkpoint that is whole."""
        whole = [found.parent for found in self.checkpoints.glob("*/chk-*/_metadata")]
        return max(whole, key=lambda path: path.stat().st_mtime_ns, default=None)


@contextmanager
def running(job: Job) -> Iterator[subprocess.Popen[bytes]]:
    """The job's process, which is told to end at the end; raises InvalidInput where something is missing."""
    packages = _packages(job.python)
    if not job.connector.is_file():
        raise InvalidInput(
            f"there is no {job.connector}", "Fetch flink-sql-connector-kafka from Maven.", "connector"
        )
    job.checkpoints.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="semap-flink-") as folder:
        code = Path(folder)
        shutil.copytree(
            Path(semap.__file__).parent,
            code / "semap",
            ignore=shutil.ignore_patterns("__pycache__", "schema"),
        )
        process = subprocess.Popen(_command(job, code), env=_environment(packages, code, job), cwd=folder)
        try:
            yield process
        finally:
            process.terminate()
            process.wait()


def _command(job: Job, code: Path) -> list[str]:
    newest = job.newest()
    settings: Mapping[str, str] = {
        "execution.checkpointing.interval": "1 s",
        "execution.checkpointing.dir": job.checkpoints.absolute().as_uri(),
        "execution.checkpointing.externalized-checkpoint-retention": "RETAIN_ON_CANCELLATION",
        "parallelism.default": str(job.parallelism),
        "pipeline.jars": job.connector.absolute().as_uri(),
        "python.executable": str(job.python.absolute()),
        "python.files": str(code),
        "python.fn-execution.bundle.time": "10",
        **({} if newest is None else {"execution.state-recovery.path": newest.absolute().as_uri()}),
    }
    said = [f"{name}={value}" for name, value in settings.items()]
    told = [part for setting in (*said, *job.settings) for part in ("--set", setting)]
    return [str(job.python), "-m", "semap.flink.job", "--servers", job.servers, "--prefix", job.prefix, *told]


def _environment(packages: Path, code: Path, job: Job) -> Mapping[str, str]:
    # some distributions of Flink lack its configuration, without whose options for Java no job starts
    conf = {} if "FLINK_CONF_DIR" in os.environ else {"FLINK_CONF_DIR": str(packages / "conf")}
    log = {"FLINK_LOG_DIR": str(job.checkpoints.absolute())}
    return {**log, **os.environ, **conf, "PYTHONPATH": str(code), MODE: "process"}


def _packages(python: Path) -> Path:
    """Where its PyFlink is."""
    try:
        asked = subprocess.run([python, "-c", WHERE], capture_output=True, text=True, check=False)
    except OSError as error:
        raise InvalidInput(
            f"{python} cannot be run: {error.strerror}", "Name an interpreter.", "python"
        ) from error
    if asked.returncode:
        said = (asked.stderr.strip().splitlines() or ["it failed"])[-1]
        raise InvalidInput(
            f"{python} lacks what the job needs: {said}",
            "pip install apache-flink shapely pyyaml, in an environment of its own.",
            "python",
        )
    return Path(asked.stdout.strip())
