"""Flink SQL with a Python function that says in which rooms a place is (bench/flink/FlinkRooms.java).

LAG over the states of each track in event time gives the rooms before; ARRAY_EXCEPT what began and ended. The
function looks up an STRtree of shapely's. There are three ways to call it: with columns in a process of its
own (a vectorised function), or state by state there or in a thread of the JVM. The first half of
the first round gets each going, its second half is measured; the quickest goes on, and the table names the
others.

Each way is one job in one JVM, which stands still between rounds, so that nothing starts or is compiled while
the clock runs. Flink keeps nothing that would outlive it: parallelism 1, no checkpoints, state on the heap,
objects reused, and the states in memory beforehand. The source with the function and the rest of the query
are two threads, and Python is a process besides.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import gcd
from pathlib import Path

import numpy as np
import shapely

from bench.crowd import Crowd
from bench.flink import environment, python_environment
from bench.flink.environment import Flink, FlinkMissing
from bench.flink.python_environment import FlinkPython
from bench.peers import Changes, Fed, Named, PeerMissing, ordered

BUNDLE = 20_000
"""States that Python is given before it must have answered, at most: more makes nothing quicker."""
# The states and Flink's own buffers; what Arrow and the cleaning up after Python reach into.
JVM = ("-Xmx3g", "--add-opens=java.base/java.nio=ALL-UNNAMED", "--add-opens=java.base/java.io=ALL-UNNAMED")
FUNCTION = environment.HERE / "room_function.py"


@dataclass(frozen=True)
class Way:
    """How Flink calls the function: the name in room_function.py, and Flink's python.execution-mode."""

    title: str
    function: str
    mode: str


# The quickest comes last, when the JVM has compiled what all need.
WAYS = (
    Way("state by state in a process", "rooms_at", "process"),
    Way("state by state in a thread", "rooms_at", "thread"),
    Way("columns in a process", "rooms_at_many", "process"),
)


@contextmanager
def begin(dsn: str, crowd: Crowd, frames: int) -> Iterator[FlinkSql]:
    del dsn
    try:
        flink, python = environment.find(), python_environment.make_python()
    except FlinkMissing as missing:
        raise PeerMissing(str(missing)) from missing
    with start(flink, python, crowd, frames) as jobs:
        tried: dict[Way, Fed] = {}
        slower: dict[str, float | str] = {}
        for way in WAYS:
            try:
                jobs.feed(way, frames // 2)
                tried[way] = jobs.feed(way, frames - frames // 2)
            except JobFailed as failed:
                slower[way.title] = str(failed)
        if not tried:
            raise PeerMissing("; ".join(f"{title}: {reason}" for title, reason in slower.items()))
        best = min(tried, key=lambda way: tried[way].seconds)
        states = (frames - frames // 2) * len(crowd.track_ids)
        slower |= {way.title: states / fed.seconds for way, fed in tried.items() if way != best}
        yield FlinkSql(jobs, best, slower)


class FlinkSql:
    def __init__(self, jobs: Jobs, way: Way, slower: Mapping[str, float | str]) -> None:
        self.named = Named(f"Flink {jobs.version} SQL, Python function: {way.title}", slower)
        self.begun = jobs.found[way]
        self._jobs = jobs
        self._way = way

    def feed(self, first: int, count: int) -> Fed:
        del first
        return self._jobs.feed(self._way, count)


class JobFailed(Exception):
    """Flink could not run a job; the message is its reason."""


@contextmanager
def start(flink: Flink, python: FlinkPython, crowd: Crowd, frames: int) -> Iterator[Jobs]:
    """A JVM that has all states of the crowd, until the end of the context.

    frames  of a round, whose halves are bundles, too
    """
    most = max(1, BUNDLE // len(crowd.track_ids))
    both = gcd(frames // 2, frames)
    bundle = max(count for count in range(1, most + 1) if both % count == 0)
    with tempfile.TemporaryDirectory(prefix="semap-flink-") as name:
        folder = Path(name)
        (folder / "rooms").write_text("\n".join(shapely.to_wkb(room, hex=True) for room in crowd.rooms))
        with (folder / "states").open("wb") as file:
            file.write(np.array([len(crowd.track_ids), len(crowd.places)], dtype=">i4").tobytes())
            file.write(crowd.track_ids.astype(">i8").tobytes())
            file.write(crowd.stamps_us.astype(">i8").tobytes())
            file.write(crowd.places.astype(">f8").tobytes())
        read = (folder / "states", folder / "rooms", python.executable, FUNCTION, bundle)
        process = subprocess.Popen(
            flink.command("FlinkRooms", *map(str, read), options=JVM, libraries=[python.library]),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            env=os.environ | {"FLINK_HOME": str(python.flink), "PYTHONPATH": str(python.packages)},
        )  # fmt: skip
        try:
            yield Jobs(process, folder / "changes", flink.version)
        finally:
            process.communicate()


class Jobs:
    """What runs in the JVM: a job for each way.

    version  Flink's
    found    what each way has found since it was begun
    """

    def __init__(self, process: subprocess.Popen[str], file: Path, version: str) -> None:
        self.version = version
        self.found: dict[Way, Changes] = {}
        self._process = process
        self._file = file

    def feed(self, way: Way, count: int) -> Fed:
        """Let the next frames of a way through.

        raises  JobFailed
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"room_function.{way.function} {way.mode} {count} {self._file}\n")
            self._process.stdin.flush()
        except BrokenPipeError as broken:
            raise JobFailed("the JVM has ended") from broken
        seconds, found = self._answer().split()
        changes = np.fromfile(self._file, dtype=">i8").astype(np.int64).reshape(int(found), 4)
        self.found[way] = ordered([*self.found.get(way, ()), *changes])
        return Fed(float(seconds), ordered(changes))

    def _answer(self) -> str:
        """What else Flink and Python print is passed over."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            kind, _, said = line.strip().partition(" ")
            if kind == "failed":
                raise JobFailed(said[-200:])
            if kind == "answer":
                return said
        raise JobFailed("the JVM has ended")
