"""Ways of persons over the floor: the shortest, with rounded corners, at a speed that suits the bends."""

from __future__ import annotations

import heapq
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

SPACING_M = 0.02
CUTS = 4
LONGEST_EDGE_M = 0.5
SIDEWAYS_RADPS = 1.6
"""How fast a walking person turns at most; slower in sharper bends."""

SLOWEST_MPS = 0.3
ACCELERATION_MPS2 = 0.9
BEND_WINDOW_M = 0.3

Polyline = NDArray[np.float64]
"""(n, 2) [m, map]"""


def shortest_way(walkable: shapely.Geometry, start_m: Polyline, end_m: Polyline) -> Polyline | None:
    """The shortest polyline between two points that stays in `walkable`; None where there is none.

    Its corners are reflex ones of `walkable` (the visibility graph of Lozano-Perez and Wesley 1979).
    """
    ends = np.array([start_m, end_m])
    shapely.prepare(walkable)
    if not shapely.covers(walkable, shapely.points(ends)).all():
        return None
    if walkable.covers(shapely.linestrings(ends)):
        return ends
    nodes = np.concatenate([ends, _reflex_corners(walkable)])
    return _cheapest(walkable, nodes)


def rounded(way_m: Polyline) -> Polyline:
    """Cut every corner at a quarter of both its edges, four times (Chaikin 1974); then even spacing.

    Long edges are split first, so that a bend is local: it passes a right angle at no more than 9 cm.
    """
    points = _split(way_m, LONGEST_EDGE_M)
    for _ in range(CUTS):
        near, far = points[:-1], points[1:]
        cut = np.stack([0.75 * near + 0.25 * far, 0.25 * near + 0.75 * far], axis=1).reshape(-1, 2)
        points = np.concatenate([points[:1], cut, points[-1:]])
    return evenly_spaced(points)


def evenly_spaced(way_m: Polyline) -> Polyline:
    """The same line with points about 2 cm apart."""
    along_m = distances_along(way_m)
    count = max(3, round(along_m[-1] / SPACING_M) + 1)
    wanted = np.linspace(0.0, along_m[-1], count)
    return np.column_stack([np.interp(wanted, along_m, way_m[:, axis]) for axis in (0, 1)])


def distances_along(way_m: Polyline) -> NDArray[np.float64]:
    """(n,) [m] from the first point."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way_m, axis=0), axis=1))])


def headings(way_m: Polyline) -> NDArray[np.float64]:
    """(n,) [rad], not wrapped: where a person faces who walks an evenly spaced way."""
    step_m = np.diff(way_m, axis=0)
    raw = np.unwrap(np.arctan2(step_m[:, 1], step_m[:, 0]))
    window = max(1, round(BEND_WINDOW_M / SPACING_M)) | 1
    padded = np.pad(raw, window // 2, mode="edge")
    smooth = np.convolve(padded, np.ones(window) / window, mode="valid")
    return np.append(smooth, smooth[-1])


def timed(way_m: Polyline, speed_mps: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n,) [s] when each point of an evenly spaced way is reached from rest to rest, (n,) [m/s] how fast.

    As fast as `speed_mps`, the bends and the acceleration allow (a forward and a backward pass over v^2).
    """
    along_m = distances_along(way_m)
    bend_radpm = np.abs(np.gradient(headings(way_m))) / np.gradient(along_m)
    limit_mps = np.minimum(speed_mps, np.maximum(SLOWEST_MPS, SIDEWAYS_RADPS / np.maximum(bend_radpm, 1e-6)))
    square = limit_mps**2
    square[[0, -1]] = 0.0
    gained = 2 * ACCELERATION_MPS2 * along_m
    square = np.minimum.accumulate(square - gained) + gained
    square = np.minimum.accumulate((square + gained)[::-1])[::-1] - gained
    speeds_mps = np.sqrt(np.maximum(square, 0.0))
    mean_mps = (speeds_mps[:-1] + speeds_mps[1:]) / 2
    return np.concatenate([[0.0], np.cumsum(np.diff(along_m) / mean_mps)]), speeds_mps


def distances_at(
    times_s: NDArray[np.float64],
    reached_s: NDArray[np.float64],
    speeds_mps: NDArray[np.float64],
    along_m: NDArray[np.float64],
) -> NDArray[np.float64]:
    """How far somebody has come at some times, speeding up evenly between points that are reached so."""
    before = np.clip(np.searchsorted(reached_s, times_s, side="right") - 1, 0, len(reached_s) - 2)
    lasts_s = reached_s[before + 1] - reached_s[before]
    passed_s = np.clip(times_s - reached_s[before], 0.0, lasts_s)
    change_mps2 = (speeds_mps[before + 1] - speeds_mps[before]) / lasts_s
    return along_m[before] + speeds_mps[before] * passed_s + change_mps2 * passed_s**2 / 2


def _split(way_m: Polyline, longest_m: float) -> Polyline:
    points = [way_m[:1]]
    for begin, end in pairwise(way_m):
        pieces = max(1, int(np.ceil(np.linalg.norm(end - begin) / longest_m)))
        share = np.arange(1, pieces + 1)[:, None] / pieces
        points.append(begin + share * (end - begin))
    return np.concatenate(points)


def _reflex_corners(walkable: shapely.Geometry) -> Polyline:
    """Corners at which a shortest way can bend: those that stick out into the walkable area."""
    found = []
    for part in shapely.get_parts(shapely.normalize(walkable)):
        oriented = shapely.orient_polygons(part)
        for ring in (oriented.exterior, *oriented.interiors):
            corners = np.asarray(ring.coords)[:-1]
            before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
            turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            found.append(corners[turn < 0])
    return np.concatenate(found)


def _cheapest(walkable: shapely.Geometry, nodes: Polyline) -> Polyline | None:
    """The shortest way from the first node to the second (A*: Hart, Nilsson and Raphael 1968)."""
    to_goal_m = np.linalg.norm(nodes - nodes[1], axis=1)
    queue: list[tuple[float, float, int, int]] = [(float(to_goal_m[0]), 0.0, 0, -1)]
    came_from: dict[int, int] = {}
    while queue:
        _, so_far_m, node, previous = heapq.heappop(queue)
        if node in came_from:
            continue
        came_from[node] = previous
        if node == 1:
            way = [1]
            while came_from[way[-1]] >= 0:
                way.append(came_from[way[-1]])
            return nodes[way[::-1]]
        open_nodes = np.array([each for each in range(len(nodes)) if each not in came_from])
        edges = np.stack([np.broadcast_to(nodes[node], (len(open_nodes), 2)), nodes[open_nodes]], axis=1)
        for other in open_nodes[shapely.covers(walkable, shapely.linestrings(edges))]:
            length_m = so_far_m + float(np.linalg.norm(nodes[other] - nodes[node]))
            heapq.heappush(queue, (length_m + float(to_goal_m[other]), length_m, int(other), node))
    return None
