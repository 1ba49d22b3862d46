"""Boxes of an image and leg clusters of a scan, of one moment, become persons on the map.

    both sensors  a box and the one or two clusters that are its legs: the body is between the legs, and
                  where the box says, each weighted by its information
    camera only   a box without legs: where the box says, which is vague
    laser only    legs in no box, paired; less credible where the camera looks and nothing hides them

What was seen at one moment does not tell which way a person walks, so that the extent of the body is
unknown: NaN.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from semap_ingest.fusion import body_from_box
from semap_ingest.fusion.body_from_box import Bodies
from semap_ingest.fusion.gaussian import agreed
from semap_ingest.fusion.legs_of_boxes import LEG_STD_M, SWAY_STD_M, LegsOfBoxes, find_legs
from semap_ingest.fusion.persons_of_laser import find_persons
from semap_ingest.fusion.placed_clusters import PlacedClusters, place_clusters
from semap_ingest.fusion.sensor_geometry import SensorGeometry, View, view_of
from semap_ingest.sensing.boxes import Boxes
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.detections import BOTH, CAMERA, Detections
from semap_ingest.sensing.image import Camera

__all__ = ["SensorGeometry", "fuse"]

WALKING_MPS = 1.0
"""Standard deviation of a person's speed along each axis: how fast what a sensor saw grows old."""
LEAST_SCORE = 0.001
LEAST_PX = 2.0


def fuse(
    boxes: Boxes | None,
    clusters: LegClusters | None,
    geometry: SensorGeometry,
    stamp_us: int,
    frame: str = "map",
    labels: Collection[str] = ("person",),
) -> Detections:
    """Persons at `stamp_us`, those with a box first, in the order of the boxes.

    boxes, clusters  None if that sensor said nothing at this moment (an empty one says that there is
                     nothing); what has no place in the map, since the geometry lacks its sensor, is left
                     out; so is what has a place that is not a number, or a box without an area in the image
    labels           classes of boxes that are persons
    raises           InvalidInput for a camera that cannot be
    """
    view = view_of(geometry)
    placed = None
    if clusters is not None and geometry.map_T_laser is not None:
        placed = place_clusters(clusters, geometry.map_T_laser, _moved_std_m(stamp_us - clusters.stamp_us))
    parts = []
    is_taken = np.zeros(0 if placed is None else len(placed), dtype=np.bool_)
    corners_px = None
    if boxes is not None and view is not None:
        kept, corners_px = _persons_among(boxes, labels, view.camera)
        bodies = _bodies(corners_px, view, _moved_std_m(stamp_us - boxes.stamp_us))
        legs = None if placed is None else find_legs(corners_px, bodies, placed, view)
        parts.append(_from_boxes(boxes, kept, bodies, placed, legs, stamp_us, frame))
        if legs is not None:
            is_taken[legs.legs[legs.legs >= 0]] = True
    if clusters is not None and placed is not None:
        with_legs = [part.position_m[part.seen_by == BOTH] for part in parts]
        bodies_m = with_legs[0] if with_legs else np.empty((0, 2))
        parts.append(find_persons(clusters, placed, is_taken, bodies_m, corners_px, view, stamp_us, frame))
    return _joined(parts, stamp_us, frame)


def _moved_std_m(time_us: int) -> float:
    return WALKING_MPS * abs(time_us) / 1e6


def _persons_among(
    boxes: Boxes, labels: Collection[str], camera: Camera
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Places of boxes of persons that have an area in the image, and their corners clipped to it."""
    border = np.array([camera.width_px, camera.height_px, camera.width_px, camera.height_px]) - 1.0
    corners = np.clip(boxes.corners_px, 0.0, border)
    with np.errstate(invalid="ignore"):
        has_area = (corners[:, 2] - corners[:, 0] >= LEAST_PX) & (corners[:, 3] - corners[:, 1] >= LEAST_PX)
    is_person = np.fromiter((label in labels for label in boxes.label), dtype=np.bool_, count=len(boxes))
    kept = np.flatnonzero(has_area & is_person)
    return kept, corners[kept]


def _bodies(corners_px: NDArray[np.float64], view: View, moved_std_m: float) -> Bodies:
    bodies = body_from_box.place(corners_px, view)
    return Bodies(bodies.position_m, bodies.covariance_m2 + moved_std_m**2 * np.eye(2), bodies.range_m)


def _from_boxes(
    boxes: Boxes,
    kept: NDArray[np.int64],
    bodies: Bodies,
    clusters: PlacedClusters | None,
    found: LegsOfBoxes | None,
    stamp_us: int,
    frame: str,
) -> Detections:
    position, covariance = bodies.position_m.copy(), bodies.covariance_m2.copy()
    seen_by = np.full(len(kept), CAMERA, dtype=np.uint8)
    score = boxes.score[kept]
    score = np.where(np.isfinite(score), score, 0.0)
    if clusters is not None and found is not None:
        seen_by[found.legs[:, 0] >= 0] = BOTH
        score = _believed(score, found.log_ratio)
        for is_kind, (legs_m, legs_m2) in _bodies_of_legs(found.legs, clusters):
            position[is_kind], covariance[is_kind] = agreed(
                legs_m, legs_m2, bodies.position_m[is_kind], bodies.covariance_m2[is_kind]
            )
    extent = np.full((len(kept), 2), np.nan)
    return Detections(stamp_us, frame, position, covariance, score, seen_by, extent, boxes.track[kept])


def _bodies_of_legs(
    legs: NDArray[np.int64], clusters: PlacedClusters
) -> list[tuple[NDArray[np.bool_], tuple[NDArray[np.float64], NDArray[np.float64]]]]:
    """Those with two legs and those with one, and what the legs say of the body's middle."""
    has_two = legs[:, 1] >= 0
    has_one = (legs[:, 0] >= 0) & ~has_two
    single = legs[has_one, 0]
    beside = np.where(clusters.is_wide[single], SWAY_STD_M, LEG_STD_M)
    one = clusters.covariance_m2[single] + beside[:, None, None] ** 2 * np.eye(2)
    return [
        (has_two, clusters.middle(legs[has_two, 0], legs[has_two, 1], SWAY_STD_M)),
        (has_one, (clusters.position_m[single, :2], one)),
    ]


def _believed(score: NDArray[np.float64], log_ratio: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bayes: the box's score as prior, the ratio of likelihoods of what the laser saw."""
    bounded = np.clip(score, LEAST_SCORE, 1 - LEAST_SCORE)
    log_odds = np.log(bounded / (1 - bounded)) + log_ratio
    return np.asarray(np.clip(1 / (1 + np.exp(-np.clip(log_odds, -30, 30))), LEAST_SCORE, 1 - LEAST_SCORE))


def _joined(parts: list[Detections], stamp_us: int, frame: str) -> Detections:
    if not parts:
        empty = np.empty((0, 2))
        return Detections(
            stamp_us,
            frame,
            empty,
            np.empty((0, 2, 2)),
            np.empty(0),
            np.empty(0, dtype=np.uint8),
            empty,
            np.empty(0, dtype=np.int64),
        )
    position = np.concatenate([part.position_m for part in parts])
    covariance = np.concatenate([part.covariance_m2 for part in parts])
    kept = np.isfinite(position).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    return Detections(
        stamp_us,
        frame,
        position[kept],
        covariance[kept],
        np.concatenate([part.score for part in parts])[kept],
        np.concatenate([part.seen_by for part in parts])[kept],
        np.concatenate([part.extent_m for part in parts])[kept],
        np.concatenate([part.hint for part in parts])[kept],
    )
