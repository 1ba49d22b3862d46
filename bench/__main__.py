"""Run benchmarks: print a table of each and write bench/results.json: median, least and most of five rounds.

python -m bench [NAME ...]    all but those that take long; --help lists them
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from bench import (
    abstractions,
    amendments,
    calls,
    certainty,
    edits,
    feed,
    growth,
    image_tracking,
    imports,
    latency,
    looking_back,
    loop_holds,
    office,
    operators,
    page,
    pairs,
    people,
    recording,
    records,
    rules,
    shapes,
    side_by_side,
    small_batches,
    solid,
    throughput,
    windows,
)
from bench.bridges import foxglove, kafka_in, mqtt, ros2, sockets
from bench.figure import Rows, as_json, joined
from semap.cluster import Cluster, lease
from semap.store.operate.schema import migrate

RESULTS = Path(__file__).parent / "results.json"


@dataclass(frozen=True)
class Benchmark:
    """What it does, what it aims at, and the run on a migrated database of its own.

    takes     how long, where that is too long for it to be run unless it is named
    repeated  it has one round, and is run as a whole again and again, each time on a new database
    """

    begins: str
    aim: str
    run: Callable[[str], Rows]
    takes: str | None = None
    repeated: bool = False


BENCHMARKS = {
    "throughput": Benchmark(
        f"{throughput.ROUNDS} rounds of {throughput.FRAMES} batches, bare COPY and triggers in turn",
        "ratio at least 0.5",
        throughput.measure,
    ),
    "peers": Benchmark(
        f"{side_by_side.ROUNDS} rounds of {side_by_side.FRAMES} batches, semap's triggers and each of"
        " bench/peers in turn",
        "the same changes by all",
        side_by_side.measure,
    ),
    "small_batches": Benchmark(
        f"{small_batches.ROUNDS} rounds of {small_batches.FRAMES} batches at 15 Hz, bare COPY and"
        " triggers in turn",
        "frames_cpu_ms less than 1 at 20 tracks",
        small_batches.measure,
    ),
    "pairs": Benchmark(
        f"{pairs.TRACKS:,} tracks and which are within {pairs.NEAR_M:g} m of which; late states beside that",
        "cpu_ms at most 20, writer_cpu_ms and correction_cpu_ms together at most 10",
        pairs.measure,
    ),
    "amendments": Benchmark(
        "a query that follows amendments: batches, amendments and what comes after them",
        "batch_cpu_ms at most 1 more than without; an amendment at most 100, a further batch at most 30",
        amendments.measure,
    ),
    "latency": Benchmark(
        f"{latency.ROUNDS} rounds of {latency.ROUND_S:.0f} s through the triggers, the log, the worker and"
        " the service, at three rates",
        "p50_ms at most 5 and p99_ms at most 10 at 1,000 states/s",
        latency.measure,
    ),
    "bridges": Benchmark(
        f"{sockets.ROUNDS} rounds of {sockets.ROUND_S:.0f} s at 15 Hz through one socket, then as fast as it"
        " goes",
        "p50_ms at most 15; 1,000 tracks at 15 Hz: late_p99_ms small",
        sockets.measure,
    ),
    "ros2": Benchmark(
        f"{len(ros2.SEEDS)} courses of the office as topics of ROS 2, to the doors' events at a client",
        "p50_ms at most 40, p99_ms at most 80",
        ros2.measure,
        "about four minutes",
    ),
    "foxglove": Benchmark(
        f"{foxglove.ROUNDS} rounds of {foxglove.ROUND_S:.0f} s: {foxglove.TRACKS} tracks at 15 Hz, shown",
        "percent_of_a_core at most 5",
        foxglove.measure,
    ),
    "kafka_in": Benchmark(
        f"{kafka_in.ROUNDS} rounds of {kafka_in.FRAMES * kafka_in.TRACKS:,} states from a topic of Kafka, and"
        " the same by COPY, both through the triggers",
        "ratio at least 0.8",
        kafka_in.measure,
        "about three minutes, and needs ./dev kafka",
    ),
    "shapes": Benchmark(
        f"{shapes.ROUNDS} rounds of {shapes.BATCHES} batches: plain rooms, {shapes.CORNERS:,} corners each,"
        " all over one another",
        "figures to compare with",
        shapes.measure,
    ),
    "edits": Benchmark(
        f"{edits.ROUNDS} stretches of {edits.STRETCH_S:.0f} s with an edit of the map each second, and as"
        " many without",
        "lost 0",
        edits.measure,
    ),
    "feed": Benchmark(
        f"{feed.READERS + feed.DEAF} WebSocket clients, {feed.EVENTS_PER_S:,} events/s for"
        f" {feed.LENGTH_S:.0f} s; then {feed.DEAF} of them do not read",
        "missed 0, out_of_order 0, deaf_still_open 0, server_peak_mb bounded",
        feed.measure,
        "about three minutes a round",
        repeated=True,
    ),
    "loop_holds": Benchmark(
        "every operation is asked what means no good, and a heartbeat in the loop of the service listens",
        f"hold_ms at most {loop_holds.GOAL_MS:g}",
        loop_holds.measure,
        "about ten minutes",
    ),
    "abstractions": Benchmark(
        "all abstractions of meshes of a million triangles",
        "seconds at most 5, peak_rss_mb at most 2048",
        lambda _: abstractions.measure(),
        repeated=True,
    ),
    "imports": Benchmark(
        "a building of 20,000 rooms, and files of 10 MB that are no maps",
        "s at most 60 for the building, at most 2 for a wrong file",
        imports.measure,
        repeated=True,
    ),
    "operators": Benchmark("questions over 100,000 instances", "p50_ms at most 10", operators.measure),
    "looking_back": Benchmark(
        "a moment, ways and pages: seven million states of 50 tracks, 100,000 instances",
        "p50_ms at most 20",
        looking_back.measure,
    ),
    "solid": Benchmark(
        "exact 3D predicates on pairs of meshes",
        "boxes apart 1 ms, surfaces apart 100 ms, touching 1 s, at 1,280 triangles",
        lambda dsn: solid.measure(dsn, 3),
    ),
    "certainty": Benchmark(
        "one thing asked of one state, as triggers do: a condition, a distance, a probability",
        "us at most 20 for the condition, at most 100 for a room",
        certainty.measure,
    ),
    "calls": Benchmark(
        "single calls that hostile or large input could make long, in processor time",
        "cpu_ms at most 3 for the lines of a scan, 100 for a scrape, 300 for help, 5000 for the others",
        calls.measure,
    ),
    "rules": Benchmark(
        f"{rules.ROUNDS} rounds of {rules.ROWS:,} rows, the engine and Flink in turn; then memory",
        "semap's rate at least Flink's, the same matches, memory flat",
        lambda _: rules.measure(),
    ),
    "records": Benchmark(
        f"{records.ROUNDS} rounds of {records.ROWS:,} rows as records: in columns, row by row; through rules",
        "columns smaller and cheaper than JSON row by row",
        lambda _: records.measure(),
    ),
    "windows": Benchmark(
        f"{windows.ROUNDS} rounds of {windows.ROWS:,} rows in windows of 1 to 1,000 s, in the engine",
        "rows/s in all windows within 2 times (relaxed: 3), the count right; (A+)+ B at most 0.1 s",
        lambda _: windows.measure(),
    ),
    "recording": Benchmark(
        "scans read from disk as values", "at least 20,000 scans/s", lambda _: recording.measure()
    ),
    "mqtt": Benchmark(
        f"{mqtt.ROUNDS} rounds of {mqtt.ROUND_S:.0f} s from a position by MQTT to its event at a client",
        "p50_ms at most 15",
        mqtt.measure,
        "about two minutes, and needs mosquitto",
    ),
    "page": Benchmark(
        f"the page in Chromium, drawn by software, with people and {page.TRIANGLES:,} triangles",
        "page_kb below 300, first_picture_ms below 1500;"
        " of 400 people, frames_per_s at least 30 with 50 moving, 10 with 200",
        page.measure,
        "about two minutes a round, and needs Chromium",
        repeated=True,
    ),
}


def benchmarks(
    extent: office.Extent, sizes: growth.Extent, mot: Path | None = None, laser: Path | None = None
) -> dict[str, Benchmark]:
    """All of them, by name."""
    return (
        BENCHMARKS
        | {
            "growth": Benchmark(
                f"{sizes.rounds} rounds through all sizes: {max(sizes.regions):,} regions,"
                f" {max(sizes.tracks):,} tracks, {max(sizes.stored):,} stored states",
                f"times_the_first at most {growth.GOAL}",
                lambda dsn: growth.measure(dsn, sizes),
                "about half an hour, and 15 GB of disk",
            ),
            "image_tracking": Benchmark(
                f"boxes of {len(image_tracking.SEEDS)} seeds and of --mot, by semap, SORT and ByteTrack",
                "mota, idf1 and hota above SORT's and at least ByteTrack's",
                lambda _: image_tracking.measure(mot),
                "about three minutes",
            ),
            "people": Benchmark(
                "people before a laser alone: made-up places, and by a classifier that does not know them the"
                " bags of --laser",
                "recall and precision at least 0.6 in a hall of a dozen, idf1 at least 0.7 of one followed"
                " outdoors, balanced at least 0.85",
                lambda _: people.measure(laser),
                "about a minute, with bags about ten",
            ),
        }
        | {
            f"office_{name}": Benchmark(
                part.begins, part.aim, partial(office.measure, name, extent), part.takes
            )
            for name, part in office.PARTS.items()
            if office.is_possible(name)
        }
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure on a server of the run's own, with semap's own settings."""
    read = _read(arguments)
    known = benchmarks(
        office.Extent(read.seeds, read.plays), _sizes(read.stored, quick=read.quick), read.mot, read.laser
    )
    results: dict[str, object] = {
        "measured_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {
            "processor": platform.machine(),
            "cores": os.cpu_count(),
            "load_1_min": round(os.getloadavg()[0], 2),
            "python": platform.python_version(),
        },
    }
    folder = Path(tempfile.mkdtemp(prefix="semap-bench-"))
    folder.chmod(0o711)
    try:
        with lease(folder) as cluster:
            for name in _chosen(read.names, known):
                benchmark = known[name]
                print(f"{name}: {benchmark.begins} ...", flush=True)
                rounds = read.rounds if benchmark.repeated else 1
                rows = joined([_run(cluster, name, benchmark) for _ in range(rounds)])
                print(f"\n{name} (aim: {benchmark.aim})")
                _table(rows)
                results[name] = as_json(rows)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    RESULTS.write_text(json.dumps(results, indent=2) + "\n")
    print(
        f"\nwritten to {RESULTS.relative_to(Path.cwd()) if RESULTS.is_relative_to(Path.cwd()) else RESULTS}"
    )


def _run(cluster: Cluster, name: str, benchmark: Benchmark) -> Rows:
    cluster.create_database(name)
    migrate(cluster.dsn(name))
    try:
        return benchmark.run(cluster.dsn(name))
    finally:
        cluster.drop_database(name)


def _sizes(stored: int, *, quick: bool) -> growth.Extent:
    """stored  the most stored states [million]"""
    if quick:
        return growth.SMALLEST
    return replace(growth.Extent(), stored=(0, stored * 100_000, stored * 1_000_000))


def _read(arguments: Sequence[str] | None) -> argparse.Namespace:
    """names, none of them unknown; seeds; plays; rounds; quick; stored; mot; laser"""
    known = benchmarks(office.Extent(1, 1), growth.Extent())
    listed = [f"  {name:<18} {each.begins}{_cost(each)}" for name, each in known.items()]
    parser = argparse.ArgumentParser(
        "python -m bench",
        description="Without names all are run but those that take long.",
        epilog="\n".join(["benchmarks:", *listed]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="office is all that begin with office_")
    parser.add_argument("--seeds", type=_count, default=20, help="for office_seeds (default: %(default)s)")
    parser.add_argument(
        "--plays", type=_count, default=3,
        help="for office_delays, at each of two rates of images (default: %(default)s; the paper's are 25,"
        " which take an hour and a half)",
    )  # fmt: skip
    parser.add_argument(
        "--rounds", type=_count, default=5, help="of what is run as a whole in each (default: %(default)s)"
    )
    parser.add_argument("--quick", action="store_true", help="growth: small sizes, to see that it works")
    parser.add_argument(
        "--stored", type=_count, default=50, metavar="MILLION", help="growth: states (default: %(default)s)"
    )
    parser.add_argument(
        "--mot", type=_folder, metavar="FOLDER",
        help="for image_tracking: sequences of the MOTChallenge too (NAME/gt/gt.txt, NAME/det/det.txt)",
    )  # fmt: skip
    parser.add_argument(
        "--laser", type=_bags, metavar="FOLDER",
        help="for people: the bags of laser_people (positive_not_extracted and the others)",
    )  # fmt: skip
    read = parser.parse_args(arguments)
    unknown = set(read.names) - {*known, "office"}
    if unknown:
        parser.error(f"there is no benchmark {', '.join(sorted(unknown))}: choose from {', '.join(known)}")
    return read


def _chosen(names: Sequence[str], known: Mapping[str, Benchmark]) -> list[str]:
    if not names:
        return [name for name, each in known.items() if each.takes is None]
    groups = ([each for each in known if each.startswith("office_")] if n == "office" else [n] for n in names)
    return list(dict.fromkeys(name for group in groups for name in group))


def _cost(benchmark: Benchmark) -> str:
    return "" if benchmark.takes is None else f" ({benchmark.takes}: only when named)"


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 on")
    return int(text)


def _folder(text: str) -> Path:
    if not any(Path(text).glob("*/gt/gt.txt")):
        raise argparse.ArgumentTypeError(f"{text!r} holds no SEQUENCE/gt/gt.txt")
    return Path(text)


def _bags(text: str) -> Path:
    missing = [bag.path for bag in people.BAGS if not (Path(text) / bag.path).is_file()]
    if missing:
        raise argparse.ArgumentTypeError(f"{text!r} holds no {missing[0]}")
    return Path(text)


def _table(rows: Rows) -> None:
    titles = list(dict.fromkeys(title for row in rows for title in row))
    lines = [titles, *([str(row.get(title, "")) for title in titles] for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(titles))]
    for line in lines:
        print("  " + "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True)))


if __name__ == "__main__":
    main()
