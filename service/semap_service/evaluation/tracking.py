"""How well persons are followed: against the truth of simulated crowds, and to look at on real scans."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from semap_ingest.pipeline.ingest_recording import Plan, opened, perception_of, surveyed_sensors
from semap_ingest.pipeline.rig_sensors import topics_of
from semap_ingest.recording.reading import Recording
from semap_ingest.sensing.scan import Scan
from semap_ingest.sensing.track_states import TrackStates
from semap_ingest.simulation.labels import TrackLabels

from semap_service.evaluation.mot_scores import MotScores, Places, mot_scores

LEAST_BEAMS = 3
"""Of a scan that must meet a person's legs for the laser to see it."""


def perceive(plan: Plan) -> Iterator[TrackStates]:
    """The states of persons in a recording, without a database."""
    rig, _, recording = opened(plan)
    with recording:
        perception = perception_of(rig, surveyed_sensors(rig, recording))
        for received in recording.records(topics_of(rig, recording.topics)):
            yield from (each.states for each in perception.take(received).persons)
        yield from (each.states for each in perception.flush().persons)


def score_crowd(plan: Plan, truth: TrackLabels, within_us: int = 0) -> MotScores:
    """Tracks against the persons that a sensor could see, at the stamps of the scans.

    within_us  so old a track's newest place may be, where sensors speak at other stamps
    """
    return mot_scores(*_judged(truth, told_at(truth, perceive(plan), within_us)))


def told_at(truth: TrackLabels, states: Iterable[TrackStates], within_us: int) -> Places:
    """Where each track was told to be last before each stamp of the truth, if that is not longer ago."""
    told = sorted((each for each in states if len(each)), key=lambda each: each.stamp_us)
    stamps: list[int] = []
    tracks: list[int] = []
    places: list[NDArray[np.float64]] = []
    first = 0
    for stamp_us in truth.stamp_us.tolist():
        newest: dict[int, NDArray[np.float64]] = {}
        while first < len(told) and told[first].stamp_us < stamp_us - within_us:
            first += 1
        for each in told[first:]:
            if each.stamp_us > stamp_us:
                break
            newest.update(zip(each.track.tolist(), each.position_m, strict=True))
        stamps += [stamp_us] * len(newest)
        tracks += newest
        places += newest.values()
    return Places(np.array(stamps, np.int64), np.array(tracks, np.int64), np.array(places).reshape(-1, 2))


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
