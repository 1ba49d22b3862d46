"""How well persons are followed: against the truth of simulated crowds, and to look at on real scans."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from semap_ingest.pipeline.ingest_recording import Plan, roles_of
from semap_ingest.pipeline.perception import Perception
from semap_ingest.pipeline.survey import survey
from semap_ingest.pipeline.topics import cast_parts
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.simulation.labels import TrackLabels

from semap_service.evaluation.mot_scores import MotScores, Places, mot_scores, places_of

LEAST_BEAMS = 3
"""Of a scan that must meet a person's legs for the laser to see it."""


def perceive(plan: Plan) -> Iterator[TrackStates]:
    """The states of persons in a recording, without a database."""
    with Recording(plan.path) as recording:
        parts = cast_parts(recording.topics, plan.topics)
        if plan.image_model is None:
            parts = parts.without("image")
        perception = Perception(
            roles_of(parts, plan), survey(recording, parts, plan.images_hz), plan.map_frame
        )
        for received in recording.records(parts.all()):
            yield from (each.states for each in perception.take(received).persons)
        yield from (each.states for each in perception.flush().persons)


def score_crowd(plan: Plan, truth: TrackLabels) -> MotScores:
    """Tracks against the persons that a sensor could see, at the stamps of the scans."""
    told = {each.stamp_us: each for each in perceive(plan) if len(each)}
    scans = [int(stamp_us) for stamp_us in truth.stamp_us]
    places = places_of([told[stamp_us] for stamp_us in scans if stamp_us in told])
    return mot_scores(*_judged(truth, places))


def _judged(truth: TrackLabels, tracks: Places) -> tuple[Places, Places]:
    """Without what cannot be asked: persons out of sight, and tracks that are on one of those.

    In sight is who is met by enough beams, or seen by the camera.
    """
    in_sight = (truth.laser_beams >= LEAST_BEAMS) | truth.in_camera
    rows, columns = np.nonzero(in_sight)
    persons = Places(truth.stamp_us[columns], rows.astype(np.int64), truth.position_m[rows, columns])
    column_of = {int(stamp_us): column for column, stamp_us in enumerate(truth.stamp_us)}
    kept = np.ones(len(tracks), dtype=np.bool_)
    for row, stamp_us in enumerate(tracks.stamp_us):
        column = column_of[int(stamp_us)]
        distance = np.hypot(*(truth.position_m[:, column] - tracks.position_m[row]).T)
        nearest = int(np.argmin(distance))
        kept[row] = in_sight[nearest, column] or distance[nearest] > 0.5
    return persons, Places(tracks.stamp_us[kept], tracks.identity[kept], tracks.position_m[kept])


def ways_in_scans(
    path: Path, least_points: int
) -> tuple[dict[str, NDArray[np.float64]], Sequence[NDArray[np.float64]]]:
    """The ways of persons in a recording of a laser that stands still, and its scans to look at.

    returns  (n, 2) [m, laser] by track, those of so many states at least; points of every fiftieth scan
    """
    with Recording(path) as recording:
        scans = [each.value for each in recording.records() if isinstance(each.value, Scan)]
    plan = Plan("", "", path, map_frame=scans[0].frame)
    ways: dict[str, list[NDArray[np.float64]]] = defaultdict(list)
    for states in perceive(plan):
        for track, position_m in zip(states.track, states.position_m, strict=True):
            ways[str(track)].append(position_m)
    long_ones = {name: np.array(way) for name, way in ways.items() if len(way) >= least_points}
    return long_ones, [scan.points_m[scan.is_return] for scan in scans[::50]]
