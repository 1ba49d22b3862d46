"""Which leg clusters belong to the person in a box: at most two, as in the paper.

A cluster comes into question if its projection, the shin at the laser's height, lies in the box, as far
as its covariance allows, and its place agrees with the body's. What speaks for one or two clusters is a
ratio of likelihoods against there being no leg and the clusters being clutter (Bayes; cf. track-oriented
hypotheses, Reid 1979): how well they agree with where the body is, how legs stand to one another, and
what the leg classifier says of them. So a cluster that is hardly a leg by itself is one where a box asks
for it. Clusters are given to all boxes together so that the product of the ratios is greatest
(`selection`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.fusion.body_from_box import Bodies, cuts_of
from semap_ingest.fusion.camera_model import project_with_derivative
from semap_ingest.fusion.gaussian import distance_squared, log_density
from semap_ingest.fusion.placed_clusters import PlacedClusters
from semap_ingest.fusion.selection import Choice, best_disjoint
from semap_ingest.fusion.sensor_geometry import View

NO_LEG, ONE_LEG, TWO_LEGS = 0.3, 0.25, 0.45
"""How many legs of a person in a box the laser sees: furniture and other persons hide them."""
CLUTTER_PER_M2 = 0.5
LEG_STD_M = 0.17
"""Of a leg beside the body's middle, along each axis, standing and walking."""
APART_STD_M = 0.35
MAX_APART_M = 0.85
SWAY_STD_M = 0.07
"""Of the middle between both legs beside the body's middle."""
MOST_CANDIDATES = 8
"""Of one box: the likeliest as single legs."""
GATE = 16.0
"""Squared Mahalanobis distance in the plane, and of the projection's margin."""


@dataclass(frozen=True, eq=False)
class LegsOfBoxes:
    """Of n boxes.

    legs       (n, 2) int64, places of clusters; -1 for none
    log_ratio  (n,) of the likelihoods with a person in the box and without
    """

    legs: NDArray[np.int64]
    log_ratio: NDArray[np.float64]


def find_legs(
    corners_px: NDArray[np.float64], bodies: Bodies, clusters: PlacedClusters, view: View
) -> LegsOfBoxes:
    """corners_px (n, 4) as in `Boxes`; bodies of the same boxes."""
    legs = np.full((len(corners_px), 2), -1, dtype=np.int64)
    log_ratio = np.full(len(corners_px), np.log(NO_LEG))
    if not len(corners_px) or not len(clusters):
        return LegsOfBoxes(legs, log_ratio)
    box, leg, gain = _single_legs(corners_px, bodies, clusters, view)
    pair_box, left, right, pair_gain = _pairs(box, leg, bodies, clusters)
    boxes = np.concatenate([box, pair_box])
    candidates = np.column_stack(
        [np.concatenate([leg, left]), np.concatenate([np.full_like(leg, -1), right])]
    )
    gains = np.concatenate([gain, pair_gain])
    choices: list[list[Choice]] = [[] for _ in corners_px]
    for place in np.flatnonzero(gains > 0).tolist():
        things = sum(1 << int(one) for one in candidates[place] if one >= 0)
        choices[boxes[place]].append(Choice(float(gains[place]), things, place))
    for one, chosen in enumerate(best_disjoint(choices)):
        if chosen is not None:
            legs[one] = candidates[chosen]
            log_ratio[one] += gains[chosen]
    return LegsOfBoxes(legs, log_ratio)


def _single_legs(
    corners_px: NDArray[np.float64], bodies: Bodies, clusters: PlacedClusters, view: View
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Boxes and clusters that come together, and the logarithm of the ratio, one leg to none."""
    box, leg = np.nonzero(_in_boxes(corners_px, clusters, view))
    offset = clusters.position_m[leg, :2] - bodies.position_m[box]
    spread = bodies.covariance_m2[box] + clusters.covariance_m2[leg] + LEG_STD_M**2 * np.eye(2)
    agrees = distance_squared(offset, spread) <= GATE
    box, leg, offset, spread = box[agrees], leg[agrees], offset[agrees], spread[agrees]
    gain = np.log(ONE_LEG / NO_LEG / CLUTTER_PER_M2) + clusters.log_odds[leg] + log_density(offset, spread)
    likeliest_first = np.lexsort((-gain, box))
    box, leg, gain = box[likeliest_first], leg[likeliest_first], gain[likeliest_first]
    is_likely = np.arange(len(box)) - np.searchsorted(box, box) < MOST_CANDIDATES
    return box[is_likely], leg[is_likely], gain[is_likely]


def _pairs(
    box: NDArray[np.int64], leg: NDArray[np.int64], bodies: Bodies, clusters: PlacedClusters
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Boxes with two of their clusters each, and the logarithm of the ratio, two legs to none."""
    first, second = np.nonzero(np.triu(box[:, None] == box, 1))
    left, right, of = leg[first], leg[second], box[first]
    apart = clusters.position_m[left, :2] - clusters.position_m[right, :2]
    is_pair = np.hypot(apart[:, 0], apart[:, 1]) <= MAX_APART_M
    left, right, of, apart = left[is_pair], right[is_pair], of[is_pair], apart[is_pair]
    middle, middle_covariance = clusters.middle(left, right, SWAY_STD_M)
    ratio = np.log(TWO_LEGS / NO_LEG / CLUTTER_PER_M2**2)
    # Either of the two may be the left leg.
    ratio += np.log(2) + clusters.log_odds[left] + clusters.log_odds[right]
    ratio += log_density(middle - bodies.position_m[of], middle_covariance + bodies.covariance_m2[of])
    spread = clusters.covariance_m2[left] + clusters.covariance_m2[right] + APART_STD_M**2 * np.eye(2)
    return of, left, right, ratio + log_density(apart, spread)


def _in_boxes(corners_px: NDArray[np.float64], clusters: PlacedClusters, view: View) -> NDArray[np.bool_]:
    """(boxes, clusters): whether the projection lies in the box, as far as its covariance allows.

    A side that the border of the image cuts off does not end there.
    """
    pixels, by_point = project_with_derivative(view.in_camera(clusters.position_m), view.camera)
    on_plane = by_point @ view.map_T_camera[:3, :3].T[:, :2]
    covariance_px2 = on_plane @ clusters.covariance_m2 @ on_plane.swapaxes(1, 2)
    margin = np.sqrt(GATE * np.maximum(0, covariance_px2[:, [0, 1], [0, 1]]))
    cuts = cuts_of(corners_px, view)
    left = np.where(cuts.left, -np.inf, corners_px[:, 0])[:, None]
    top = np.where(cuts.top, -np.inf, corners_px[:, 1])[:, None]
    right = np.where(cuts.right, np.inf, corners_px[:, 2])[:, None]
    bottom = np.where(cuts.bottom, np.inf, corners_px[:, 3])[:, None]
    u, v = pixels.T
    in_width = (u >= left - margin[:, 0]) & (u <= right + margin[:, 0])
    return np.asarray(in_width & (v >= top - margin[:, 1]) & (v <= bottom + margin[:, 1]))
