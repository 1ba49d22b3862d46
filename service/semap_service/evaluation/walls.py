"""Four cameras on walls, over six rooms and their hallway: people whom several see, and the time it takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from semap_ingest.pipeline.ingest_recording import Plan
from semap_ingest.simulation.labels import TrackLabels, read_labels
from semap_ingest.simulation.office import OfficePaths
from semap_ingest.simulation.settings import OfficeSettings
from semap_ingest.simulation.wall_sensors import CAMERAS

from semap_service.evaluation.mot_scores import Places
from semap_service.evaluation.tracking import perceive, score_crowd, told_at

CAMERA_COUNT = 4
BOXES = tuple(f"/{each.name}/boxes" for each in CAMERAS[:CAMERA_COUNT])
WITHIN_US = 210_000
"""The slowest of them takes five images a second."""
NEAR_M = 1.0


def plan_of_walls(
    map_name: str, paths: OfficePaths, boxes: Sequence[str] = BOXES, scan: Sequence[str] = ()
) -> Plan:
    return Plan(map_name, "walls", paths.recording, topics={"scan": scan, "boxes": boxes})


def doubled(truth: TrackLabels, places: Places) -> float:
    """The share of places of tracks that are of a person who has another track at that stamp."""
    column_of = {int(stamp_us): column for column, stamp_us in enumerate(truth.stamp_us)}
    near = twice = 0
    for stamp_us in np.unique(places.stamp_us):
        told_m = places.position_m[places.stamp_us == stamp_us]
        person = _nearest(truth.position_m[:, column_of[int(stamp_us)]], told_m)
        near += len(person)
        twice += len(person) - len(set(person.tolist()))
    return twice / near


def _nearest(truth_m: NDArray[np.float64], told_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """Whom each track is of, without those that are of nobody."""
    distance_m = np.linalg.norm(truth_m[:, None] - told_m, axis=2)
    return np.asarray(distance_m.argmin(axis=0)[distance_m.min(axis=0) < NEAR_M], np.int64)


def wall_scores(paths: OfficePaths) -> dict[str, float]:
    """IDF1 of all cameras together and of the best alone, MOTA and HOTA, and doubled tracks."""
    labels = read_labels(paths.labels)
    truth = replace(labels.tracks, laser_beams=np.zeros_like(labels.tracks.laser_beams))
    alone = [score_crowd(plan_of_walls("", paths, [each]), truth, WITHIN_US) for each in BOXES]
    every = score_crowd(plan_of_walls("", paths), truth, WITHIN_US)
    places = told_at(labels.tracks, perceive(plan_of_walls("", paths)), WITHIN_US)
    return {
        "idf1": every.idf1,
        "idf1_best_alone": max(each.idf1 for each in alone),
        "mota": every.mota,
        "mota_best_alone": max(each.mota for each in alone),
        "hota": every.hota,
        "doubled": doubled(labels.tracks, places),
    }


def wall_settings(people: int, seed: int) -> OfficeSettings:
    return OfficeSettings(seed=seed, people=people, camera=False, wall_cameras=CAMERA_COUNT)
