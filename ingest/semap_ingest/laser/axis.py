"""Where the axis of a leg is, of which a laser sees only one side.

A leg is a circle of a radius that is known roughly. Its centre is estimated together with the radius from
three things: the distance of each point to the circle, the beams at which it begins and ends, and what
legs usually measure (Gauss-Newton on all clusters of a scan at once, in a frame whose first axis points
from the laser to the middle of the cluster). What is too wide for one leg, such as two legs side by side,
is taken as it stands: its middle, moved back by what hides in a leg.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semap_ingest.laser.clusters import ScanClusters

# the visible half of a circle lies on average this part of the radius before its centre
MEAN_FACE = np.pi / 4
STEPS = 4
FURTHEST_M = 0.1

Values = NDArray[np.float64]


@dataclass(frozen=True)
class LegShape:
    """What a leg is expected to be, and how well it is measured.

    radius_m      at the height of the laser, in trousers, with its standard deviation
    range_std_m   of one range
    shape_std_m   how far cloth is from a circle
    widest_m      a wider cluster is not one leg
    hidden_std_m  how well an edge is known that something nearer may hide
    """

    radius_m: float = 0.065
    radius_std_m: float = 0.015
    range_std_m: float = 0.02
    shape_std_m: float = 0.01
    widest_m: float = 0.25
    hidden_std_m: float = 0.04


def locate_axes(
    clusters: ScanClusters, step_rad: float, is_hidden: NDArray[np.bool_], shape: LegShape = LegShape()
) -> tuple[Values, Values]:
    """Centres (n, 2) [m, laser] and their covariances (n, 2, 2) [m2].

    step_rad   between two beams
    is_hidden  (n,) whether something nearer stands at an edge of the cluster
    """
    if not len(clusters):
        return np.zeros((0, 2)), np.zeros((0, 2, 2))
    width = np.hypot(*(clusters.points_m[clusters.stop - 1] - clusters.points_m[clusters.first]).T)
    turned, local = _turned(clusters)
    mean = clusters.mean(local)
    centre, covariance = _coarse(mean, width, shape)
    narrow = np.flatnonzero(width <= shape.widest_m)
    if len(narrow):
        chosen = replace(clusters, first=clusters.first[narrow], stop=clusters.stop[narrow])
        of_narrow = local[np.isin(clusters.cluster_of, narrow)]
        fine, fine_covariance = _fitted(
            chosen, of_narrow, mean[narrow], abs(step_rad), is_hidden[narrow], shape
        )
        is_near = np.abs(fine - centre[narrow]).max(axis=1) < FURTHEST_M
        centre[narrow[is_near]] = fine[is_near]
        covariance[narrow[is_near]] = fine_covariance[is_near]
    return (
        np.einsum("nji,nj->ni", turned, centre),
        np.einsum("nji,njk,nkl->nil", turned, covariance, turned),
    )


def _turned(clusters: ScanClusters) -> tuple[Values, Values]:
    """Axes of each cluster's own frame (n, 2, 2), first that from the laser; the members in it (m, 2)."""
    towards = clusters.points_m[clusters.first] / clusters.range_m[clusters.first, None]
    towards = towards + clusters.points_m[clusters.stop - 1] / clusters.range_m[clusters.stop - 1, None]
    towards /= np.maximum(np.hypot(*towards.T), 1e-9)[:, None]
    turned = np.stack([towards, np.column_stack([-towards[:, 1], towards[:, 0]])], axis=1)
    local = np.einsum("mij,mj->mi", turned[clusters.cluster_of], clusters.points_m[clusters.member])
    return turned, local


def _coarse(mean: Values, width: Values, shape: LegShape) -> tuple[Values, Values]:
    """The middle of the visible face, moved back."""
    centre = mean + np.array([MEAN_FACE * shape.radius_m, 0.0])
    along = shape.range_std_m**2 + shape.radius_std_m**2 + shape.shape_std_m**2
    covariance = np.zeros((len(mean), 2, 2))
    covariance[:, 0, 0] = along
    covariance[:, 1, 1] = along + width**2 / 12
    return centre, covariance


def _fitted(
    clusters: ScanClusters,
    local: Values,
    mean: Values,
    step_rad: float,
    is_hidden: NDArray[np.bool_],
    shape: LegShape,
) -> tuple[Values, Values]:
    """Most likely centre in the frame of each cluster, and its covariance; unknowns are centre and radius."""
    range_m = np.maximum((clusters.range_m[clusters.first] + clusters.range_m[clusters.stop - 1]) / 2, 1e-3)
    spacing = range_m * step_rad
    edge_0 = clusters.points_m[clusters.first] / clusters.range_m[clusters.first, None]
    edge_1 = clusters.points_m[clusters.stop - 1] / clusters.range_m[clusters.stop - 1, None]
    half_width = range_m * np.hypot(*(edge_1 - edge_0).T) / 2 + spacing / 2
    # an edge is somewhere between the last beam that hit and the first that did not
    edge_variance = spacing**2 / 24 + shape.shape_std_m**2 + np.where(is_hidden, shape.hidden_std_m**2, 0)

    of_points = 1 / (shape.range_std_m**2 + shape.shape_std_m**2)
    # what is asked of (along, across, radius) besides the points, and how firmly
    asked = np.column_stack([np.zeros(len(mean)), np.zeros(len(mean)), half_width])
    firm = np.column_stack([np.zeros(len(mean)), 1 / edge_variance, 1 / edge_variance])
    usual = np.array([0.0, 0.0, shape.radius_m])
    known = np.array([0.0, 0.0, shape.radius_std_m**-2])

    state: Values = np.column_stack(
        [mean[:, 0] + MEAN_FACE * shape.radius_m, np.zeros(len(mean)), np.full(len(mean), shape.radius_m)]
    )
    for _ in range(STEPS):
        offset = local - state[clusters.cluster_of, :2]
        distance = np.maximum(np.hypot(*offset.T), 1e-6)
        slope = np.column_stack([-offset / distance[:, None], -np.ones(len(local))])
        miss = distance - state[clusters.cluster_of, 2]
        normal = clusters.total(slope[:, :, None] * slope[:, None, :]) * of_points
        gradient = clusters.total(slope * miss[:, None]) * of_points
        normal += np.einsum("nk,kl->nkl", firm + known, np.eye(3)) + 1e-6 * np.eye(3)
        gradient += firm * (state - asked) + known * (state - usual)
        state = state - np.linalg.solve(normal, gradient[:, :, None])[:, :, 0]
    # that a leg is no circle errs in all of its points alike
    covariance = np.linalg.inv(normal)[:, :2, :2].astype(np.float64) + shape.shape_std_m**2 * np.eye(2)
    return state[:, :2], covariance
