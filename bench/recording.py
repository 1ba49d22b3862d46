"""Scans per second out of recordings on disk, as values: every format, read with a cold file cache.

A scan is that of a SICK TiM: 811 beams with intensities, 6.5 kB.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.scan import Scan

from bench.figure import figure

SCANS = 10_000
ROUNDS = 5
BEAMS = 811
PERIOD_NS = 66_666_667
FIRST_NS = 1_767_225_600_000_000_000
SCAN = "sensor_msgs/msg/LaserScan"


def measure() -> list[dict[str, object]]:
    """One row for each format: rates [scans/s], also by the processor's time."""
    with tempfile.TemporaryDirectory(prefix="semap-bench-") as folder:
        return [_measured(name, write(Path(folder) / name)) for name, write in FORMATS.items()]


def _measured(name: str, path: Path) -> dict[str, object]:
    rates, cpu_rates = zip(*(_rates(path) for _ in range(ROUNDS)), strict=True)
    return {
        "format": name,
        "scans": SCANS,
        "beams": BEAMS,
        "mb": round(sum(file.stat().st_size for file in _files(path)) / 1e6),
        "scans_per_s": figure(rates),
        "scans_per_cpu_s": figure(cpu_rates),
    }


def _rates(path: Path) -> tuple[float, float]:
    """By the clock and by the processor's time."""
    for file in _files(path):
        _forget(file)
    started_s, started_cpu_s = time.perf_counter(), time.process_time()
    with Recording(path) as recording:
        scans = sum(isinstance(received.value, Scan) for received in recording.records())
    elapsed_s, elapsed_cpu_s = time.perf_counter() - started_s, time.process_time() - started_cpu_s
    assert scans == SCANS
    return scans / elapsed_s, scans / elapsed_cpu_s


def _files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(path.iterdir())


def _forget(file: Path) -> None:
    """Out of the system's cache, so that it is read from disk."""
    with file.open("rb") as opened:
        os.fsync(opened.fileno())
        os.posix_fadvise(opened.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _messages(store: Typestore) -> list[Any]:
    """A room of 8 x 5 m seen from its middle, with noise and dropouts, for 40 periods."""
    dice = np.random.default_rng(0)
    angles_rad = np.radians(np.linspace(-135, 135, BEAMS))
    walls_m = np.minimum(4 / np.abs(np.cos(angles_rad)), 2.5 / np.abs(np.sin(angles_rad) + 1e-9))
    of_ros1 = {"seq": 0} if "seq" in dict(store.fielddefs["std_msgs/msg/Header"][1]) else {}
    messages = []
    for _ in range(40):
        ranges_m = (walls_m + dice.normal(0, 0.01, BEAMS)).astype(np.float32)
        ranges_m[dice.random(BEAMS) < 0.01] = np.inf
        stamp = store.types["builtin_interfaces/msg/Time"](sec=FIRST_NS // 10**9, nanosec=0)
        messages.append(
            store.types[SCAN](
                header=store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="laser", **of_ros1),
                angle_min=float(angles_rad[0]),
                angle_max=float(angles_rad[-1]),
                angle_increment=float(np.radians(1 / 3)),
                time_increment=0.0,
                scan_time=PERIOD_NS / 1e9,
                range_min=0.05,
                range_max=25.0,
                ranges=ranges_m,
                intensities=dice.integers(100, 4000, BEAMS).astype(np.float32),
            )
        )
    return messages


def _write(writer: Writer1 | Writer2, store: Typestore, serialise: Callable[[Any, str], memoryview]) -> None:
    raw = [serialise(message, SCAN) for message in _messages(store)]
    with writer:
        connection = writer.add_connection("/scan", SCAN, typestore=store)
        for number in range(SCANS):
            writer.write(connection, FIRST_NS + number * PERIOD_NS, raw[number % len(raw)])


def _ros1(path: Path, compression: Writer1.CompressionFormat | None = None) -> Path:
    store, writer = get_typestore(Stores.ROS1_NOETIC), Writer1(path.with_suffix(".bag"))
    if compression is not None:
        writer.set_compression(compression)
    _write(writer, store, store.serialize_ros1)
    return path.with_suffix(".bag")


def _ros2(path: Path, plugin: StoragePlugin, compression: CompressionMode = CompressionMode.NONE) -> Path:
    store, writer = get_typestore(Stores.ROS2_HUMBLE), Writer2(path, version=9, storage_plugin=plugin)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    _write(writer, store, store.serialize_cdr)
    return path


FORMATS: dict[str, Callable[[Path], Path]] = {
    "ROS 1 bag": _ros1,
    "ROS 1 bag, lz4": lambda path: _ros1(path, Writer1.CompressionFormat.LZ4),
    "MCAP": lambda path: _ros2(path, StoragePlugin.MCAP),
    "MCAP, zstd": lambda path: _ros2(path, StoragePlugin.MCAP, CompressionMode.STORAGE),
    "sqlite3": lambda path: _ros2(path, StoragePlugin.SQLITE3),
}
