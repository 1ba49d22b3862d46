"""States from a topic of Kafka through the triggers, beside a COPY of the same states through the triggers.

The topic is filled before. A round of the bridge begins with its process and ends when the last state is
stored; what its start takes is measured by a record that comes first. Both commit every batch durably.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from threading import Event as Signal
from threading import Thread

import numpy as np
import psycopg
from confluent_kafka import Producer
from confluent_kafka.admin import AdminClient, NewTopic
from numpy.typing import NDArray
from semap_bridge.config import read_config
from semap_bridge.running import run_bridge
from semap_ingest.state_copy import COPY_STATES, copy_rows

from bench.crowd import RATE_HZ, add_tracks, batches, import_rooms, walk
from bench.figure import Rows, figure
from bench.kafka.broker import Broker, running_broker
from bench.throughput import FIRST_US, FLOOR
from semap.store.database.connection import connect

TRACKS = 1000
FRAMES = 200
ROUNDS = 5
COUNT = (
    "select coalesce(sum(track_states), 0) from semap.source_count join semap.source using (source_id)"
    " where map_id = %s"
)


def measure(dsn: str, rounds: int = ROUNDS, frames: int = FRAMES) -> Rows:
    """A row for each form of the records: columns, a frame each; and a state each."""
    with tempfile.TemporaryDirectory() as folder, running_broker(Path(folder), _until) as broker:
        return [
            _measure(dsn, broker, Path(folder), form, rounds, frames)
            for form in ("a frame each", "a state each")
        ]


def _measure(
    dsn: str, broker: Broker, folder: Path, form: str, rounds: int, frames: int
) -> dict[str, object]:
    rates: dict[str, list[float]] = {"kafka": [], "copy": []}
    places = walk(FLOOR, TRACKS, frames, 5.0)
    with connect(dsn) as connection:
        connection.execute("select semap.ensure_partitions(array[date '2026-01-01'])")
        for number in range(rounds + 1):
            name = f"{form} {number}"
            topic = name.replace(" ", "_")
            _fill(broker, topic, form, places)
            map_id = import_rooms(connection, name, FLOOR.rooms())
            kafka = _through_kafka(dsn, connection, broker, folder, name, topic, map_id, places)
            copied = import_rooms(connection, f"{name} by copy", FLOOR.rooms())
            track_ids = add_tracks(connection, copied, TRACKS, TRACKS)
            rows = batches(track_ids, places, FIRST_US)
            started_s = time.perf_counter()
            with connection.cursor() as cursor:
                copy = partial(copy_rows, COPY_STATES, cursor)
                for each in rows:
                    copy(each)
            if number:  # the first warms up
                rates["copy"].append(places.shape[0] * TRACKS / (time.perf_counter() - started_s))
                rates["kafka"].append(kafka)
    return {
        "records": form,
        "tracks": TRACKS,
        "kafka_per_s": figure(rates["kafka"]),
        "copy_per_s": figure(rates["copy"]),
        "ratio": figure([k / c for k, c in zip(rates["kafka"], rates["copy"], strict=True)], 2),
    }


def _fill(broker: Broker, topic: str, form: str, places: NDArray[np.float64]) -> None:
    admin = AdminClient({"bootstrap.servers": broker.address})
    admin.create_topics([NewTopic(topic, 1, 1)])[topic].result()
    producer = Producer(
        {
            "bootstrap.servers": broker.address,
            "enable.idempotence": True,
            "queue.buffering.max.messages": 10**6,
        }
    )
    names = [f"person {number}" for number in range(places.shape[1])]
    for number, frame in enumerate(places):
        stamp_us = FIRST_US + round(number * 1e6 / RATE_HZ)
        xs, ys = frame[:, 0].round(3).tolist(), frame[:, 1].round(3).tolist()
        same = {"stamp_us": stamp_us, "z_m": 1.0, "std_m": 0.05}
        if form == "a frame each":
            producer.produce(topic, json.dumps({"track": names, "x_m": xs, "y_m": ys, **same}))
            continue
        for name, x_m, y_m in zip(names, xs, ys, strict=True):
            producer.produce(topic, json.dumps({"x_m": x_m, "y_m": y_m, **same}), name)
    producer.flush()
    producer.close()


def _through_kafka(
    dsn: str,
    connection: psycopg.Connection,
    broker: Broker,
    folder: Path,
    name: str,
    topic: str,
    map_id: int,
    places: NDArray[np.float64],
) -> float:
    """States per second, from the first commit on, of those after it."""
    config = folder / "bridges.yaml"
    config.write_text(
        f"map: {name}\nbridges:\n"
        f"  - {{name: kafka, kind: kafka, servers: '{broker.address}', states: {topic}}}\n"
    )
    stop = Signal()
    thread = Thread(target=run_bridge, args=(dsn, read_config(config).bridges[0], stop))
    thread.start()

    def stored() -> int:
        row = connection.execute(COUNT, [map_id]).fetchone()
        return int(row[0]) if row else 0

    try:
        _until(stored)
        first, started_s = stored(), time.perf_counter()
        _until(lambda: stored() >= places.shape[0] * TRACKS)
        return (places.shape[0] * TRACKS - first) / (time.perf_counter() - started_s)
    finally:
        stop.set()
        thread.join()


def _until(happens: Callable[[], object]) -> None:
    while not happens():
        Signal().wait(0.01)
