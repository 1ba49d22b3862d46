"""The simulated office, played through all of semap and compared with its labels: the paper's experiment.

What `semap evaluate office` does, on the benchmarks' server. Each part also writes a picture and its figures
into bench/office/.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from semap_service.evaluation.office import Stage, evaluate
from semap_service.evaluation.report import write
from semap_service.processes.supervisor import Supervisor

from bench.figure import once

FOLDER = Path(__file__).parent / "office"
REAL_DATA = Path(__file__).parents[2] / "shared" / "data"
PEOPLE = (1, 5, 10, 20)


@dataclass(frozen=True)
class Part:
    """takes  how long, where that is too long for it to be measured unless it is named"""

    begins: str
    aim: str
    takes: str | None = None


PARTS = {
    "detection": Part(
        "the recording once, its events against its labels",
        "16 of 16 transitions within 500 ms, all openings, 12 of 12 relations, nothing else",
    ),
    "throughput": Part(
        f"the recording at full speed, with {', '.join(map(str, PEOPLE))} people", "share at most 0.5"
    ),
    "tracking": Part(
        f"the tracks of {', '.join(map(str, PEOPLE))} people against where they were",
        "figures to compare with",
    ),
    "walls": Part(
        "four cameras on walls over six rooms, without a detector's time",
        "IDF1 above the best camera's, doubled tracks below 0.01, share below 1",
    ),
    "scans": Part("people tracked through real scans", "a picture to look at"),
    "repeat": Part(
        "the recording at full speed and in real time", "the same events with the same ids", "3 minutes"
    ),
    "seeds": Part(
        "other schedules of the office", "recall and precision at least 0.95", "1.5 minutes for each seed"
    ),
    "delays": Part(
        "the recording in real time, images at 30 Hz and at 7.5 Hz",
        "median_ms at most 25, p99_ms below 67, at both rates",
        "3.5 minutes for each play",
    ),
}


@dataclass(frozen=True)
class Extent:
    """How much is measured: so many other seeds; so many plays at each of the two rates of images."""

    seeds: int
    plays: int


def is_possible(part: str) -> bool:
    """Whether there is what it needs: real scans are not everywhere."""
    return part != "scans" or (REAL_DATA / "laser_people").is_dir()


def measure(part: str, extent: Extent, dsn: str) -> list[dict[str, object]]:
    with Supervisor(dsn) as supervisor:
        supervisor.start("work")
        stage = Stage(dsn, lambda line: print(line, flush=True))
        report = evaluate(stage, part, seeds=extent.seeds, plays=extent.plays, people=PEOPLE, data=REAL_DATA)
    write(report, FOLDER)
    for line in report.details:
        print(f"   {line}")
    return [
        {title: once(each, 3) if isinstance(each, float) else each for title, each in row.items()}
        for row in report.rows
    ]
