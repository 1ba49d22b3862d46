"""Boxes that a program finds in the pictures of fixed cameras, as persons on the map.

Each message tells of one object, and now and then only: whom it does not name may be there nevertheless. The
pipeline is that of recordings, a sensor of the rig for each camera; while nothing comes the clock goes on for
it, so that who is seen no more leaves.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from semap_ingest.named_states import MOST_AHEAD_S, Refused
from semap_ingest.pipeline.found import Found
from semap_ingest.pipeline.ingest_recording import perception_of
from semap_ingest.pipeline.rig import CameraEntry, Rig, read_rig
from semap_ingest.pipeline.rig_sensors import sensors_of
from semap_ingest.recording.reading import Received
from semap_ingest.sensing.boxes import Boxes

from semap.errors import InvalidInput
from semap_bridge.adapter import Batch
from semap_bridge.finds import FindBatches
from semap_bridge.messages.told import CameraBox

PATIENCE_US = 1_000_000
"""So much later than it was seen a box may come, where the rig does not say."""


def read_camera_rig(path: Path) -> Rig:
    """A rig of fixed cameras; raises InvalidInput for anything else."""
    rig = read_rig(path)
    for name, each in rig.sensors.items():
        fixed = isinstance(each, CameraEntry) and each.calibration is not None and each.mount is not None
        if not fixed or (isinstance(each, CameraEntry) and each.file is not None):
            raise InvalidInput(
                f"{name} is no fixed camera",
                "Write kind: camera, topic: the name that it has there, and a homography, or a calibration"
                " and a mount.",
                f"{path}: sensors",
            )
    return rig


class Watching:
    """Mutable: the pipeline, and what was told of it."""

    def __init__(self, rig: Rig, kept_s: float, map_name: str, source: str) -> None:
        """kept_s: a person of whom nothing was told for so long is gone"""
        sensors = [
            replace(each, is_followed=True, tells_all=False, patience_us=_patience_us(rig, each.name))
            for each in sensors_of(rig, {})
        ]
        self._perception = perception_of(rig, sensors, kept_us=round(kept_s * 1e6))
        now = datetime.now(UTC)
        self._finds = FindBatches(map_name, source, f"{now:%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z", rig.floor_z_m)
        self._numbers: dict[tuple[str, str], int] = {}
        self._count = 0
        self._newest_us: dict[str, int] = {}
        self._left_out: Counter[str] = Counter()
        self._cameras = {each.topic for each in sensors}

    def take(self, told: Sequence[CameraBox], now_us: int) -> list[Batch]:
        """What follows from these; from none, as the clock goes on."""
        if not told:
            return self._batches([self._perception.come_to(now_us)])
        by_moment: dict[tuple[int, str], list[CameraBox]] = defaultdict(list)
        refused = []
        for place, each in enumerate(told):
            if each.stamp_us > now_us + MOST_AHEAD_S * 1e6:  # others would be late beside it
                refused.append(Refused(place, "stamp ahead of this clock", each.camera))
            elif each.camera in self._cameras:
                by_moment[each.stamp_us, each.camera].append(each)
            else:
                refused.append(Refused(place, "the rig has no such camera", each.camera))
        found = [self._perception.take(self._received(*key, by_moment[key])) for key in sorted(by_moment)]
        return [*self._batches(found), *([Batch(refused=refused)] if refused else [])]

    def _received(self, stamp_us: int, camera: str, told: Iterable[CameraBox]) -> Received:
        """One box of each object, the last; where more of a moment comes later, it is of the next."""
        last: Mapping[str, CameraBox] = {each.object: each for each in told}
        if stamp_us == self._newest_us.get(camera):
            stamp_us += 1
        self._newest_us[camera] = stamp_us
        many = len(last)
        boxes = Boxes(
            stamp_us,
            camera,
            np.array([each.corners_px for each in last.values()], np.float64).reshape(-1, 4),
            np.array([each.score for each in last.values()], np.float64),
            tuple(each.label for each in last.values()),
            np.array([self._number(camera, known_as) for known_as in last], np.int64).reshape(many),
        )
        return Received(stamp_us, camera, boxes)

    def _number(self, camera: str, known_as: str) -> int:
        self._count += 1
        return self._numbers.setdefault((camera, known_as), self._count)

    def forget(self, camera: str, known_as: str) -> None:
        """It is told to be over: its id does not come again."""
        self._numbers.pop((camera, known_as), None)

    def _batches(self, found: Iterable[Found]) -> list[Batch]:
        batches = [batch for each in found for batch in self._finds.batches(each)]
        left_out = Counter(self._perception.left_out)
        new, self._left_out = left_out - self._left_out, left_out
        refused = [Refused(0, reason, "") for reason, count in new.items() for _ in range(count)]
        return [*batches, *([Batch(refused=refused)] if refused else [])]


def _patience_us(rig: Rig, name: str) -> int:
    said = rig.sensors[name].patience_s
    return PATIENCE_US if said is None else round(said * 1e6)
