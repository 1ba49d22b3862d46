"""What a robot's own perception has found, made ready for semap's."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from semap.geometry.pose import transform_points
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.detections import BOTH, Detections
from semap_ingest.sensing.transform import PersonPoses

PERSON = "person"
POSE_STD_M = 0.2
"""Of a person's position where its finder does not say."""

FARTHEST_M = 1e6
"""From the map's origin: nothing that is farther can be stored."""


def person_boxes(boxes: Boxes, classes: Collection[str]) -> Boxes:
    """The boxes of persons, and those that say no class; all with the label that detectors of semap give."""
    names = {name.lower() for name in classes}
    kept = [row for row, label in enumerate(boxes.label) if not label or label.lower() in names]
    return replace(
        boxes,
        corners_px=boxes.corners_px[kept],
        score=boxes.score[kept],
        label=(PERSON,) * len(kept),
        track=boxes.track[kept],
    )


def persons_on_map(
    poses: PersonPoses, map_T_frame: NDArray[np.float64], map_frame: str, track: NDArray[np.int64]
) -> Detections:
    """Persons as if both sensors had seen them.

    track  (n,) the number of each to its finder; -1: it does not say

    The variance along the frame's z axis is not told: where that axis is not upright (a camera's is not), it
    is taken to be the mean of the other two.
    """
    covariance_m2 = poses.covariance_m2.copy()
    covariance_m2[np.isnan(covariance_m2).any(axis=(1, 2))] = np.eye(2) * POSE_STD_M**2
    across, along = map_T_frame[:2, :2], map_T_frame[:2, 2]
    along_m2 = np.trace(covariance_m2, axis1=1, axis2=2)[:, None, None] / 2 * np.outer(along, along)
    position_m = transform_points(map_T_frame, poses.position_m)[:, :2]
    near = np.flatnonzero((np.abs(position_m) < FARTHEST_M).all(axis=1))
    count = len(near)
    return Detections(
        poses.stamp_us,
        map_frame,
        position_m[near],
        (across @ covariance_m2 @ across.T + along_m2)[near],
        poses.score[near],
        np.full(count, BOTH, dtype=np.uint8),
        np.full((count, 2), np.nan),
        track[near],
    )
