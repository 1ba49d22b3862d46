"""Persons that only the laser saw: legs that belong to no box, in pairs or single."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from semap_ingest.fusion.camera_model import project
from semap_ingest.fusion.placed_clusters import PlacedClusters
from semap_ingest.fusion.sensor_geometry import View
from semap_ingest.laser.pairing import pair_legs
from semap_ingest.sensing.clusters import LegClusters
from semap_ingest.sensing.detections import LASER, Detections

PAIR_STD_M, SINGLE_STD_M = 0.1, 0.2
PARTNER_LOG_ODDS = 0.7
"""What a second leg beside it adds to a leg: little, for table legs come in pairs as well."""
SINGLE_LOG_ODDS = -0.7
MISSED_BY_CAMERA, MISSED_BEHIND_PERSON = 0.15, 0.6
"""How often an image detector misses a person in full view, and one whom a nearer person hides."""
WAIST_M = 1.0
SEEN_UP_TO_M = 10.0
LEAST_SCORE = 0.1
"""Of a leg: what is less goes on with no track, and what is little more begins none."""
SAME_BODY_M = 0.3
"""So near to the middle of a body, two more legs are a coat, a bag or parts of the same legs."""


def find_persons(
    clusters: LegClusters,
    placed: PlacedClusters,
    is_taken: NDArray[np.bool_],
    bodies_m: NDArray[np.float64],
    corners_px: NDArray[np.float64] | None,
    view: View | None,
    stamp_us: int,
    frame: str,
) -> Detections:
    """Persons of those clusters that are free.

    is_taken    (clusters placed,) belongs to a box
    bodies_m    (n, 2) [m, map] of persons whose legs were found
    corners_px  of all boxes, as in `Boxes`; None if the camera said nothing
    """
    is_free = np.zeros(len(clusters), dtype=np.bool_)
    is_free[placed.source] = ~is_taken & ~_near(placed.position_m[:, :2], bodies_m)
    place_of = np.full(len(clusters) + 1, -1)
    place_of[placed.source] = np.arange(len(placed))
    legs = place_of[pair_legs(clusters, is_free, LEAST_SCORE)]
    is_pair = legs[:, 1] >= 0
    second = np.where(is_pair, legs[:, 1], legs[:, 0])
    position, covariance = placed.middle(legs[:, 0], second, 0.0)
    # A single leg is not known twice as well for being its own partner.
    covariance = np.where(is_pair[:, None, None], covariance, placed.covariance_m2[legs[:, 0]])
    is_whole = is_pair | placed.is_wide[legs[:, 0]]
    covariance += np.where(is_whole, PAIR_STD_M, SINGLE_STD_M)[:, None, None] ** 2 * np.eye(2)
    log_odds = (placed.log_odds[legs[:, 0]] + placed.log_odds[second]) / 2
    log_odds += np.where(is_pair, PARTNER_LOG_ODDS, np.where(is_whole, 0.0, SINGLE_LOG_ODDS))
    if len(legs) and view is not None and corners_px is not None:
        log_odds += _log_missed(position, corners_px, view)
    return Detections(
        stamp_us,
        frame,
        position,
        covariance,
        1 / (1 + np.exp(-log_odds)),
        np.full(len(legs), LASER, dtype=np.uint8),
        np.full((len(legs), 2), np.nan),
        np.full(len(legs), -1, dtype=np.int64),
    )


def _near(position_m: NDArray[np.float64], bodies_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,), whether it is where a body is."""
    offset = position_m[:, None] - bodies_m
    return np.asarray((np.hypot(offset[..., 0], offset[..., 1]) < SAME_BODY_M).any(axis=1))


def _log_missed(
    position_m: NDArray[np.float64], corners_px: NDArray[np.float64], view: View
) -> NDArray[np.float64]:
    """(n,), logarithm of how likely it is that the camera has no box for a person who stands there."""
    waist = np.column_stack([position_m, np.full(len(position_m), view.floor_z_m + WAIST_M)])
    u, v = project(view.in_camera(waist), view.camera).T
    with np.errstate(invalid="ignore"):
        is_in_view = (u > 0) & (u < view.camera.width_px - 1) & (v > 0) & (v < view.camera.height_px - 1)
    away = position_m - view.centre_m[:2]
    is_in_view &= np.hypot(away[:, 0], away[:, 1]) <= SEEN_UP_TO_M
    x_min, y_min, x_max, y_max = corners_px.T
    in_box = (u[:, None] >= x_min) & (u[:, None] <= x_max) & (v[:, None] >= y_min) & (v[:, None] <= y_max)
    missed = np.where(in_box.any(axis=1), MISSED_BEHIND_PERSON, MISSED_BY_CAMERA)
    return np.asarray(np.where(is_in_view, np.log(missed), 0.0))
