"""`A B within 2 s` over enter and leave events, by the rule engine and by Flink in turns.

Both read the same rows, made beforehand and held in memory: SplitMix64 of a row's number gives its key and
its kind, and its stamp is its number in milliseconds. The clock runs from the first row handed over to the
last match found, so that starting either, and making the rows, is left out. One round warms both up.

semap's engine is given a watermark after each thousand rows, as the worker gives it after each batch, and
makes whole events with their evidence, in one thread. Flink has parallelism 1, no checkpoints, objects
reused, its state on the heap and a watermark each 200 ms, its default; its source and its matching are two
threads.

Memory is that of a process that lets the engine take ten times as many rows, asks for what is to be stored
after each batch, and says its resident size on the way.
"""

from __future__ import annotations

import gc
import json
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bench.figure import figure, once
from bench.flink.environment import Flink, FlinkMissing, find
from semap.intake.intake import Intake
from semap.model.event import Event
from semap.rules.engine.engine import Engine
from semap.rules.engine.rule import Rule
from semap.rules.row import RANKS, Row

ROWS = 1_000_000
KEYS = 1_000
BATCH = 1_000
ROUNDS = 5
MS_US = 1_000
MAP_ID = 1
QUERY_ID = 1
SAID_AT = (1_000_000, 2_000_000, 5_000_000, 10_000_000)
# The rows of a round and Flink's own buffers.
FLINK_JVM = ("-Xmx3g",)

RULE = Rule.from_json(
    1,
    {
        "map_id": MAP_ID,
        "name": "entered_then_left",
        "version": 1,
        "enabled": True,
        "queries": {"track_in_room": QUERY_ID},
        "declaration": {
            "input": "track_in_room",
            "partition_by": "track",
            "pattern": "A B",
            "define": {"A": "type = 'began'", "B": "type = 'ended'"},
            "within": "2 s",
            "emit": "entered_then_left",
        },
    },
)

Pairs = npt.NDArray[np.int64]
"""(n, 2): the numbers of the rows bound to A and B, by A's."""


def measure() -> list[dict[str, object]]:
    """A row for each way, and one for the memory."""
    rows = list(make_rows(0, ROWS))
    # What is not to be collected is not looked through: a worker holds a batch, not a million rows.
    gc.collect()
    gc.freeze()
    ways: dict[str, list[tuple[float, Pairs]]] = {"semap": []}
    with tempfile.TemporaryDirectory() as folder:
        try:
            flink = FlinkRounds(find(), Path(folder) / "matches")
            ways |= {f"Flink {flink.version} CEP": [], f"Flink {flink.version} SQL": []}
        except FlinkMissing as missing:
            print(f"without Flink: {missing}", flush=True)
            flink = None
        for _ in range(ROUNDS + 1):
            ways["semap"].append(_round(rows))
            if flink is not None:
                ways[f"Flink {flink.version} CEP"].append(flink.round("cep"))
                ways[f"Flink {flink.version} SQL"].append(flink.round("sql"))
        if flink is not None:
            flink.stop()
    gc.unfreeze()
    return [_summary(way, rounds[1:], ways["semap"][0][1]) for way, rounds in ways.items()] + [_memory()]


def _summary(way: str, rounds: list[tuple[float, Pairs]], wanted: Pairs) -> dict[str, object]:
    rates = [ROWS / seconds for seconds, _ in rounds]
    return {
        "way": way,
        "rows": ROWS,
        "keys": KEYS,
        "rows_per_s": figure(rates),
        "matches": len(rounds[0][1]),
        "same_matches": all(np.array_equal(pairs, wanted) for _, pairs in rounds),
    }


def make_rows(first: int, count: int) -> Iterator[Row]:
    """Rows `first` and on; FlinkRate.java makes the same."""
    numbers = np.arange(first, first + count, dtype=np.uint64)
    mixed = (numbers + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    mixed = (mixed ^ (mixed >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    mixed = (mixed ^ (mixed >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    mixed = mixed ^ (mixed >> np.uint64(31))
    keys = ((mixed >> np.uint64(32)) % np.uint64(KEYS)).tolist()
    began = ((mixed & np.uint64(1)) == 0).tolist()
    names = [f"track {key}" for key in range(KEYS)]
    for number, key, begins in zip(range(first, first + count), keys, began, strict=True):
        stamp_us = number * MS_US
        values = {
            "input": "track_in_room", "type": "began" if begins else "ended", "stamp": stamp_us,
            "since": stamp_us, "cause": "moved", "track": names[key], "track_id": key,
            "instance": "kitchen", "instance_id": 7, "room": "kitchen", "room_id": 7, "concept": "Room",
        }  # fmt: skip
        uid = f"00000000-0000-0000-0000-{number:012x}"
        yield Row(stamp_us, RANKS["relation"], uid, "relation", values, ("Room", "Space"))


def _both_halves() -> tuple[Intake, Engine]:
    intake, engine = Intake(), Engine()
    for half in (intake, engine):
        half.change_rule(RULE.rule_id, RULE)
    return intake, engine


def _round(rows: list[Row]) -> tuple[float, Pairs]:
    """Seconds, and what was found."""
    intake, engine = _both_halves()
    pairs: list[list[int]] = []
    started_s = time.perf_counter()
    for first in range(0, len(rows), BATCH):
        batch = rows[first : first + BATCH]
        for row in batch:
            intake.arrive(MAP_ID, row)
        intake.watermark(MAP_ID, 1, batch[-1].stamp_us)
        pairs += [_pair(event) for due in intake.due() for event in engine.take(due)]
    return time.perf_counter() - started_s, _ordered(pairs)


def _pair(event: Event) -> list[int]:
    return [row.uid.int for row in event.evidence]


def _ordered(pairs: list[list[int]]) -> Pairs:
    found: Pairs = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return found[np.argsort(found[:, 0])]


class FlinkRounds:
    """FlinkRate.java at work; each round is a job of its own in one JVM."""

    def __init__(self, flink: Flink, file: Path) -> None:
        self.version = flink.version
        self._file = file
        command = flink.command("FlinkRate", str(ROWS), str(KEYS), options=FLINK_JVM)
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )

    def round(self, family: str) -> tuple[float, Pairs]:
        """Seconds, and what was found."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{family} {self._file}\n")
        self._process.stdin.flush()
        seconds, found = self._process.stdout.readline().split()
        numbers = [list(pair) for pair in struct.iter_unpack(">ii", self._file.read_bytes())]
        assert len(numbers) == int(found)
        return float(seconds), _ordered(numbers)

    def stop(self) -> None:
        """Let the JVM end."""
        self._process.communicate()


def _memory() -> dict[str, object]:
    done = subprocess.run(
        [sys.executable, "-m", "bench.rules"], capture_output=True, text=True, check=True, timeout=3600
    )
    sizes: list[float] = json.loads(done.stdout)
    return {
        "way": "semap, memory",
        "rows": SAID_AT[-1],
        "keys": KEYS,
        **{
            f"rss_mb_at_{rows // 1_000_000}_m": once(size, 1)
            for rows, size in zip(SAID_AT, sizes, strict=True)
        },
    }


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return round(pages * 4096 / 1e6, 1)


def _take_many() -> list[float]:
    """The resident size [MB] at each of SAID_AT rows."""
    intake, engine = _both_halves()
    sizes = []
    for first in range(0, SAID_AT[-1], BATCH):
        for row in make_rows(first, BATCH):
            intake.arrive(MAP_ID, row)
        intake.watermark(MAP_ID, 1, row.stamp_us)
        for due in intake.due():
            engine.take(due)
        intake.changes()
        engine.changes()
        if first + BATCH in SAID_AT:
            sizes.append(_resident_mb())
    return sizes


if __name__ == "__main__":
    print(json.dumps(_take_many()))
