"""All records of a simulated recording, in the order of the log.

Each record is logged when it would have arrived: a scan some 5 ms after its last beam (its stamp is that of
the first), an image some 15 ms after it was taken, a transform after 1 ms.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from math import ceil

import numpy as np

from semap_ingest.simulation.cloud_view import PERIOD_S as CLOUD_PERIOD_S
from semap_ingest.simulation.cloud_view import CloudView
from semap_ingest.simulation.floor import CAMERA
from semap_ingest.simulation.labels import stamp_us
from semap_ingest.simulation.laser_view import PERIOD_S as SCAN_PERIOD_S
from semap_ingest.simulation.laser_view import SWEEP_S, LaserView, Ranges, measured
from semap_ingest.simulation.localisation import (
    AHEAD_S,
    LOCALISATION_PERIOD_S,
    ODOM_PERIOD_S,
    STATIC,
    map_from_odom,
    odom_from_base,
)
from semap_ingest.simulation.message import (
    CLOUD,
    IMAGE,
    INFO,
    SCAN,
    STATIC_TF,
    TF,
    Record,
    camera_info_data,
    cloud_data,
    image_data,
    scan_data,
    tf_data,
)
from semap_ingest.simulation.moment import Moment
from semap_ingest.simulation.noise import Stream, noise
from semap_ingest.simulation.schedule import Moments
from semap_ingest.simulation.settings import OfficeSettings, Sensor
from semap_ingest.simulation.wall_sensors import WallLaser, wall_boxes, wall_cameras, wall_lasers

IMAGE_PERIOD_S = 1 / 30
FIRST_SCAN_S = 0.011
FIRST_IMAGE_S = 0.024
FIRST_CLOUD_S = 0.037
TF_LEAD_S = 0.2
"""Transforms begin so much before the first record that needs them."""

SCAN_DELAY_S = SWEEP_S + 0.005
IMAGE_DELAY_S = 0.015
IMAGE_JITTER_S = 0.006
CLOUD_DELAY_S = 0.008
TF_DELAY_S = 0.001
STAMP_JITTER_S = 0.0004


def image_times(settings: OfficeSettings) -> list[float]:
    """When images are taken [s]; none where the camera is silent."""
    return (
        _times(settings, IMAGE_PERIOD_S, FIRST_IMAGE_S, Stream.IMAGE_CLOCK, "camera")
        if settings.camera
        else []
    )


class ScanStream:
    """Scans, which are remembered: labels say how well each person was seen in them."""

    def __init__(self, settings: OfficeSettings, course: Moments) -> None:
        self._settings, self._course = settings, course
        self.stamps_us: list[int] = []
        self.moments: list[Moment] = []
        self.ranges: list[Ranges] = []

    def records(self) -> Iterator[Record]:
        view = LaserView(self._course.floor)
        times = _times(self._settings, SCAN_PERIOD_S, FIRST_SCAN_S, Stream.SCAN_CLOCK, "laser")
        for number, time_s in enumerate(times):
            first, last = self._course.at(time_s), self._course.at(time_s + SWEEP_S)
            ranges = view.sweep(first, last)
            self.stamps_us.append(stamp_us(time_s))
            self.moments.append(first)
            self.ranges.append(ranges)
            data = scan_data(
                stamp_us(time_s), measured(ranges.true_m, noise(self._settings, Stream.SCAN, number))
            )
            yield Record(stamp_us(time_s + SCAN_DELAY_S), SCAN, data)


def recording(
    settings: OfficeSettings, course: Moments, scans: ScanStream, jpegs: Iterator[bytes]
) -> Iterator[Record]:
    """Every record. jpegs  one for each of `image_times`"""
    streams = [_static(settings), _odometry(settings), _localisation(settings), scans.records()]
    if settings.camera:
        streams.append(_images(settings, jpegs))
    streams += [wall_boxes(settings, course, each) for each in wall_cameras(settings)]
    streams += [_wall_scans(settings, course, each) for each in wall_lasers(settings)]
    if settings.cloud:
        streams.append(_clouds(settings, course))
    return heapq.merge(*streams, key=lambda record: record.log_us)


def _images(settings: OfficeSettings, jpegs: Iterator[bytes]) -> Iterator[Record]:
    late = noise(settings, Stream.IMAGE_DELAY)
    arrived_us = 0
    for time_s, jpeg in zip(image_times(settings), jpegs, strict=True):
        delay_s = IMAGE_DELAY_S + late.uniform(-IMAGE_JITTER_S, IMAGE_JITTER_S)
        arrived_us = max(stamp_us(time_s + delay_s), arrived_us + 1)
        yield Record(arrived_us, INFO, camera_info_data(stamp_us(time_s), CAMERA))
        yield Record(arrived_us, IMAGE, image_data(stamp_us(time_s), CAMERA.frame, jpeg))


def _clouds(settings: OfficeSettings, course: Moments) -> Iterator[Record]:
    view = CloudView(course.floor)
    for number in range(ceil((settings.duration_s - FIRST_CLOUD_S) / CLOUD_PERIOD_S)):
        time_s = FIRST_CLOUD_S + number * CLOUD_PERIOD_S
        points_m = view.points(course.at(time_s), noise(settings, Stream.CLOUD, number))
        yield Record(
            stamp_us(time_s + CLOUD_PERIOD_S + CLOUD_DELAY_S), CLOUD, cloud_data(stamp_us(time_s), points_m)
        )


def _wall_scans(settings: OfficeSettings, course: Moments, laser: WallLaser) -> Iterator[Record]:
    view = LaserView(course.floor, laser.place)
    number = 0
    while (time_s := laser.first_s + number * SCAN_PERIOD_S) < settings.duration_s:
        ranges = view.sweep(course.at(time_s), course.at(time_s + SWEEP_S))
        spoilt = measured(ranges.true_m, noise(settings, Stream.WALL_LASER, number * 10 + laser.number))
        data = scan_data(stamp_us(time_s), spoilt, laser.name)
        yield Record(stamp_us(time_s + SCAN_DELAY_S), f"/{laser.name}/scan", data)
        number += 1


def _static(settings: OfficeSettings) -> Iterator[Record]:
    at_us = stamp_us(-TF_LEAD_S)
    on_walls = [("map", each.name, each.pose) for each in wall_cameras(settings)]
    on_walls += [("map", each.name, each.pose) for each in wall_lasers(settings)]
    yield Record(at_us, STATIC_TF, tf_data(STATIC_TF, at_us, [*STATIC, *on_walls]))


def _odometry(settings: OfficeSettings) -> Iterator[Record]:
    edge = ("odom", "base_link", odom_from_base())
    for number in range(ceil((settings.duration_s + TF_LEAD_S) / ODOM_PERIOD_S) + 1):
        time_s = number * ODOM_PERIOD_S - TF_LEAD_S
        yield Record(stamp_us(time_s + TF_DELAY_S), TF, tf_data(TF, stamp_us(time_s), [edge]))


def _localisation(settings: OfficeSettings) -> Iterator[Record]:
    count = ceil((settings.duration_s + TF_LEAD_S) / LOCALISATION_PERIOD_S) + 1
    for number, pose in enumerate(map_from_odom(count, noise(settings, Stream.LOCALISATION))):
        time_s = number * LOCALISATION_PERIOD_S - TF_LEAD_S
        dated_us = stamp_us(time_s + AHEAD_S)
        yield Record(stamp_us(time_s + TF_DELAY_S), TF, tf_data(TF, dated_us, [("map", "odom", pose)]))


def _times(
    settings: OfficeSettings, period_s: float, first_s: float, stream: Stream, sensor: Sensor
) -> list[float]:
    """When a sensor takes its records, with the jitter of its clock, but for its gaps."""
    count = max(0, ceil((settings.duration_s - first_s) / period_s))
    jitter = noise(settings, stream).uniform(-STAMP_JITTER_S, STAMP_JITTER_S, count)
    times = first_s + np.arange(count) * period_s + jitter
    gaps = [gap for gap in settings.gaps if gap.sensor == sensor]
    return [float(time_s) for time_s in times if not any(gap.covers(time_s) for gap in gaps)]
