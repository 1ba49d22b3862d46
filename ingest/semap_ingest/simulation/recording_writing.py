"""Write a simulated recording as one MCAP file of ROS 2; what happened in it comes back as labels."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer

from semap_ingest.simulation.images import jpegs
from semap_ingest.simulation.in_view import track_labels
from semap_ingest.simulation.labels import Labels, label
from semap_ingest.simulation.message import STATIC_TF, Record, type_of, typestore
from semap_ingest.simulation.recording_stream import ScanStream, image_times, recording
from semap_ingest.simulation.schedule import Moments
from semap_ingest.simulation.settings import START_US, OfficeSettings
from semap_ingest.simulation.wall_sensors import wall_cameras

TENTH_US = 100_000
NO_TIME = QosTime(0, 0)
LATCHED = Qos(
    QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
    NO_TIME, NO_TIME, QosLiveliness.AUTOMATIC, NO_TIME, False,
)  # fmt: skip
"""As tf_static is published: who comes later hears it, too."""


def write_recording(
    path: Path, settings: OfficeSettings, course: Moments, advance: Callable[[int, int], None]
) -> Labels:
    """Write all records of a course of events.

    advance  called with the tenths of a second written and those there are in all
    """
    scans = ScanStream(settings, course)
    images = jpegs(settings, course, image_times(settings))
    total = round(settings.duration_s * 1_000_000 / TENTH_US)
    done = 0
    with closing(images), _mcap(path) as write:
        for record in recording(settings, course, scans, images):
            write(record)
            tenth = min(total, (record.log_us - START_US) // TENTH_US)
            if tenth > done:
                done = tenth
                advance(done, total)
    advance(total, total)
    names = tuple(person.name for person in course.people)
    on_walls = wall_cameras(settings)
    tracks = track_labels(course.floor, names, scans.stamps_us, scans.moments, scans.ranges, on_walls)
    return label(settings, course, tracks)


@contextmanager
def _mcap(path: Path) -> Iterator[Callable[[Record], None]]:
    """One file; gives a function that writes a record into it."""
    bag = path.with_suffix("")
    connections: dict[str, Connection] = {}
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:

        def write(record: Record) -> None:
            topic = record.topic
            if topic not in connections:
                qos = [LATCHED] if topic == STATIC_TF else []
                connections[topic] = writer.add_connection(
                    topic, type_of(topic), typestore=typestore(), offered_qos_profiles=qos
                )
            writer.write(connections[topic], record.log_us * 1000, record.data)

        yield write
    (bag / f"{bag.name}.mcap").replace(path)
    shutil.rmtree(bag)
