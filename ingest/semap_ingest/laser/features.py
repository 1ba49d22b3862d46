"""What a cluster of a scan looks like: the numbers that a leg is told by.

Sources: [A] Arras, Mozos, Burgard, "Using boosted features for the detection of people in 2D range data",
ICRA 2007 (without its speed, which needs a second scan, and with means in place of its sums); [L] Leigh,
Pineau, Olmedo, Zhang, "Person tracking and following with 2D laser scanners", ICRA 2015; [X] Xavier, Pacheco,
Castro, Ruano, Nunes, "Fast line, arc/circle and leg detection from laser scan data in a player driver", ICRA
2005. The others say in a robust way what a leg looks like that is hit by few beams, and what stands around.
None of them counts beams: the same leg has about the same values whatever the resolution, and `spacing_m`
says how well they are known.

A jump is never told longer than JUMP_REACH_M, nor anything around farther than AROUND_M, and where there is
none these are the values: a leg must not be told by the room behind it. All values are finite.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from semap_ingest.laser.clusters import ScanClusters
from semap_ingest.sensing.scan import Scan

JUMP_REACH_M = 0.3
NEAREST_REACH_M = 1.0
AROUND_M = 1.0
CROWDED_M = (0.3, 0.6, 1.0)
FACE_M = 0.25
"""So far behind the middle of a cluster is still beside it."""
WALL_M = 0.6
NARROW_WITHIN_M = (1.0, 2.0)
BLOCK = 1024
"""So many clusters at once, so that memory stays small whatever comes."""
MAX_RADIUS_M = 2.0
LEG_WIDTHS_M = (0.02, 0.35)
LEAST_M = 1e-3

FEATURES = (
    "std_m",  # [A] from the centroid
    "median_deviation_m",  # [A] mean distance to the median
    "jump_before_m",  # [A] to the return clockwise of it
    "jump_after_m",  # [A] to the return counter-clockwise of it
    "width_m",  # [A] first to last point
    "radius_m",  # [A] of that circle
    "boundary_m",  # [A] length along the points
    "regularity_m",  # [A] standard deviation of the distances of neighbouring points
    "curvature_per_m",  # [A] mean; positive where it bulges towards the laser
    "turn_rad",  # [A] mean angle between neighbouring stretches; positive as above
    "inscribed_rad",  # [X] mean angle under which a point sees the first and the last
    "inscribed_std_rad",  # [X]
    "distance_m",  # [L] of the median from the laser
    "occluded_before",  # [L] something nearer stands clockwise of it, or the scan ends
    "occluded_after",  # [L]
    "line_rms_m",  # [A] residual of a line
    "circle_rms_m",  # [A] of a circle
    "bulge_m",  # how far the middle is nearer to the laser than the ends
    "depth_m",  # farthest less nearest range
    "nearest_m",  # to the nearest cluster of a leg's width, centre to centre
    "nearest_width_m",  # the width of that cluster
    "spacing_m",  # of neighbouring beams at its distance
    "points_per_width",  # how many points there are, to how many its width has room for
    "across_m",  # width as seen from the laser
    "slant",  # how much farther one end is than the other, by the width
    "bulge_per_across",
    "gap_before_m",  # how much farther the next return clockwise is, or nearer
    "gap_after_m",
    "alone_m",  # to the nearest other return
    "alone_beside_m",  # to the nearest that is not behind it
    "crowd_0_m",  # length of what else was met within CROWDED_M
    "crowd_1_m",
    "crowd_2_m",
    "narrow_1",  # clusters of a leg's width within NARROW_WITHIN_M
    "narrow_2",
    "wall_off_m",  # from the line through what is around
    "wall_spread",  # how little that is a line
)

Values = NDArray[np.float64]


def describe(scan: Scan, clusters: ScanClusters) -> NDArray[np.float32]:
    """All features of all clusters (n, len(FEATURES)), in the order of FEATURES.

    Clusters of fewer than three points are described as well; what needs three points is 0 for them.
    """
    if not len(clusters):
        return np.zeros((0, len(FEATURES)), np.float32)
    points = clusters.points_m[clusters.member]
    centroid = clusters.mean(points)
    count = clusters.count.astype(np.float64)
    median, median_deviation = _median(clusters, points)
    offset = points - centroid[clusters.cluster_of]
    spread = clusters.total(np.einsum("ij,ij->i", offset, offset))
    width = np.hypot(*(clusters.points_m[clusters.stop - 1] - clusters.points_m[clusters.first]).T)
    line, circle, radius = _line_and_circle(clusters, offset)
    jumps, occluded = _neighbours(scan, clusters)
    distance = np.hypot(*median.T)
    nearest, nearest_width = _nearest(centroid, width)
    bulge, depth = _depth(clusters)
    spacing = distance * abs(scan.angle_step_rad)
    across, slant = _silhouette(scan, clusters, width)
    columns = [
        np.sqrt(spread / np.maximum(count - 1, 1)),
        median_deviation,
        *jumps,
        width,
        radius,
        *_boundary(clusters),
        *_inscribed(clusters, points),
        distance,
        *occluded,
        np.sqrt(line / count),
        np.sqrt(circle / count),
        bulge,
        depth,
        nearest,
        nearest_width,
        spacing,
        count * spacing / np.maximum(width, LEAST_M),
        across,
        slant,
        bulge / np.maximum(across, LEAST_M),
        *_around(scan, clusters, centroid, width),
    ]
    return np.column_stack(columns).astype(np.float32)


def column(described: NDArray[np.float32], name: str) -> NDArray[np.float32]:
    """One feature (n,) of what `describe` gave."""
    return described[:, FEATURES.index(name)]


def _median(clusters: ScanClusters, points: Values) -> tuple[Values, Values]:
    """Median of x and of y (n, 2), and the mean distance to it (n,)."""
    start = clusters.offset
    lower, upper = start + (clusters.count - 1) // 2, start + clusters.count // 2
    median = np.empty((len(clusters), 2))
    for axis in range(2):
        ordered = points[np.lexsort((points[:, axis], clusters.cluster_of)), axis]
        median[:, axis] = (ordered[lower] + ordered[upper]) / 2
    return median, clusters.mean(np.hypot(*(points - median[clusters.cluster_of]).T))


def _line_and_circle(clusters: ScanClusters, offset: Values) -> tuple[Values, Values, Values]:
    """Squared residuals of the best line and of an algebraic circle [m2], and its radius [m] (each (n,)).

    offset  (m, 2) of the members from their centroid
    The line is the principal axis; the circle is that of Kasa (1976). A circle beyond MAX_RADIUS_M is a line.
    """
    x, y = offset.T
    z = x * x + y * y
    xx, xy, yy, xz, yz = clusters.total(np.column_stack([x * x, x * y, y * y, x * z, y * z])).T
    line = np.maximum((xx + yy) / 2 - np.hypot((xx - yy) / 2, xy), 0)
    determinant = xx * yy - xy * xy
    is_round = determinant > 1e-9 * (xx + yy) ** 2
    safe = np.where(is_round, determinant, 1)
    centre = np.column_stack([yy * xz - xy * yz, xx * yz - xy * xz]) / (2 * safe[:, None])
    radius = np.sqrt(np.einsum("ij,ij->i", centre, centre) + (xx + yy) / clusters.count)
    is_round &= radius < MAX_RADIUS_M
    miss = np.hypot(*(offset - centre[clusters.cluster_of]).T) - radius[clusters.cluster_of]
    circle = np.where(is_round, clusters.total(miss * miss), line)
    return line, circle, np.where(is_round, radius, MAX_RADIUS_M)


def _neighbours(scan: Scan, clusters: ScanClusters) -> tuple[tuple[Values, Values], tuple[Values, Values]]:
    """Jumps to the returns before and after [m], and whether something nearer stands there (each (n,))."""
    jumps, occluded = [], []
    for edge, step in ((clusters.first, -1), (clusters.stop - 1, 1)):
        beside = np.clip(edge + step, 0, len(clusters.beam) - 1)
        jump = np.hypot(*(clusters.points_m[beside] - clusters.points_m[edge]).T)
        jumps.append(np.where(beside == edge, JUMP_REACH_M, np.minimum(jump, JUMP_REACH_M)))
        is_adjacent = np.abs(clusters.beam[beside] - clusters.beam[edge]) == 1
        is_nearer = is_adjacent & (clusters.range_m[beside] < clusters.range_m[edge])
        is_end = (clusters.beam[edge] == 0) | (clusters.beam[edge] == len(scan.ranges_m) - 1)
        occluded.append((is_nearer | (is_end & ~is_adjacent)).astype(np.float64))
    return (jumps[0], jumps[1]), (occluded[0], occluded[1])


def _boundary(clusters: ScanClusters) -> tuple[Values, Values, Values, Values]:
    """Length [m], its regularity [m], mean curvature [1/m] and mean turn [rad] of the points (each (n,))."""
    points = clusters.points_m[clusters.member]
    stretch = np.zeros_like(points)
    stretch[1:] = np.diff(points, axis=0)
    rank = np.arange(len(points)) - clusters.offset[clusters.cluster_of]
    stretch[rank == 0] = 0
    length = np.hypot(*stretch.T)
    stretches = np.maximum(clusters.count - 1, 1)
    boundary = clusters.total(length)
    deviation = np.where(rank == 0, 0, length - (boundary / stretches)[clusters.cluster_of])
    regularity = np.sqrt(clusters.total(deviation**2) / stretches)

    before, after = stretch[:-1], stretch[1:]
    is_corner = rank[1:] >= 2
    cross = after[:, 0] * before[:, 1] - after[:, 1] * before[:, 0]
    turn = np.zeros(len(points))
    turn[1:] = np.where(is_corner, np.arctan2(cross, np.einsum("ij,ij->i", before, after)), 0)
    sides = length[:-1] * length[1:] * np.hypot(*(before + after).T)
    curvature = np.zeros(len(points))
    # Menger: four times the signed area of the triangle by the product of its sides
    curvature[1:] = np.divide(2 * cross, sides, out=np.zeros_like(sides), where=is_corner & (sides > 1e-12))
    corners = np.maximum(clusters.count - 2, 1)
    return boundary, regularity, clusters.total(curvature) / corners, clusters.total(turn) / corners


def _inscribed(clusters: ScanClusters, points: Values) -> tuple[Values, Values]:
    """Mean and standard deviation [rad] of the angle under which inner points see the ends (each (n,))."""
    to_first = clusters.points_m[clusters.first][clusters.cluster_of] - points
    to_last = clusters.points_m[clusters.stop - 1][clusters.cluster_of] - points
    cross = to_first[:, 0] * to_last[:, 1] - to_first[:, 1] * to_last[:, 0]
    angle = np.arctan2(np.abs(cross), np.einsum("ij,ij->i", to_first, to_last))
    place = clusters.member
    is_inner = (place > clusters.first[clusters.cluster_of]) & (
        place < clusters.stop[clusters.cluster_of] - 1
    )
    inner = np.maximum(clusters.count - 2, 1)
    mean = clusters.total(np.where(is_inner, angle, 0)) / inner
    miss = np.where(is_inner, angle - mean[clusters.cluster_of], 0)
    return mean, np.sqrt(clusters.total(miss**2) / inner)


def _depth(clusters: ScanClusters) -> tuple[Values, Values]:
    """How far the inner points are nearer than the ends, and the spread of ranges [m] (each (n,))."""
    range_m = clusters.range_m[clusters.member]
    ends = (clusters.range_m[clusters.first] + clusters.range_m[clusters.stop - 1]) / 2
    inner = np.maximum(clusters.count - 2, 1)
    middle = (clusters.total(range_m) - 2 * ends) / inner
    start = clusters.offset
    spread = np.maximum.reduceat(range_m, start) - np.minimum.reduceat(range_m, start)
    return np.where(clusters.count > 2, ends - middle, 0), spread


def _nearest(centroid: Values, width: Values) -> tuple[Values, Values]:
    """Distance to the nearest other cluster of a leg's width, and that width [m] (each (n,))."""
    narrow = np.flatnonzero((width >= LEG_WIDTHS_M[0]) & (width <= LEG_WIDTHS_M[1]))
    if len(narrow) < 2:
        return np.full(len(width), NEAREST_REACH_M), np.zeros(len(width))
    reach, found = cKDTree(centroid[narrow]).query(centroid, k=2, distance_upper_bound=NEAREST_REACH_M)
    found = np.where(np.isfinite(reach), found, 0)
    is_self = narrow[found[:, 0]] == np.arange(len(width))
    reach = np.where(is_self, reach[:, 1], reach[:, 0])
    other = np.where(is_self, found[:, 1], found[:, 0])
    is_near = np.isfinite(reach)
    return np.where(is_near, reach, NEAREST_REACH_M), np.where(is_near, width[narrow[other]], 0)


def _silhouette(scan: Scan, clusters: ScanClusters, width: Values) -> tuple[Values, Values]:
    """Width as seen from the laser [m], and how slanting it stands to it, 0 to 1 (each (n,))."""
    beams = np.abs(clusters.beam[clusters.stop - 1] - clusters.beam[clusters.first])
    before, after = clusters.range_m[clusters.first], clusters.range_m[clusters.stop - 1]
    across = (before + after) * np.sin(np.minimum(beams * abs(scan.angle_step_rad), np.pi) / 2)
    return across, np.abs(after - before) / np.maximum(width, LEAST_M)


def _around(scan: Scan, clusters: ScanClusters, centroid: Values, width: Values) -> list[Values]:
    """What is met around each cluster (each (n,)), in the order of FEATURES."""
    last = len(clusters.points_m) - 1
    before, after = np.maximum(clusters.first - 1, 0), np.minimum(clusters.stop, last)
    gap_before = clusters.range_m[before] - clusters.range_m[clusters.first]
    gap_after = clusters.range_m[after] - clusters.range_m[clusters.stop - 1]
    is_narrow = (width >= LEG_WIDTHS_M[0]) & (width <= LEG_WIDTHS_M[1])
    legs = cKDTree(centroid[is_narrow]) if is_narrow.any() else None
    narrow = [
        (0 if legs is None else legs.query_ball_point(centroid, reach_m, return_length=True)) - is_narrow
        for reach_m in NARROW_WITHIN_M
    ]
    tree = cKDTree(clusters.points_m)
    blocks = [
        _met_around(scan, clusters, tree, centroid, width, rows)
        for rows in np.split(np.arange(len(clusters)), range(BLOCK, len(clusters), BLOCK))
    ]
    alone, beside, *crowds, off, spread = np.concatenate(blocks, axis=1)
    gaps = [np.clip(each, -AROUND_M, AROUND_M) for each in (gap_before, gap_after)]
    return [*gaps, alone, beside, *crowds, *narrow, off, spread]


def _met_around(
    scan: Scan,
    clusters: ScanClusters,
    tree: cKDTree,
    centroid: Values,
    width: Values,
    rows: NDArray[np.int64],
) -> Values:
    """(7, rows): to the nearest other return, and the nearest beside; the crowds; the wall."""
    found = tree.query_ball_point(centroid[rows], AROUND_M + width[rows] / 2)
    row = np.repeat(np.arange(len(rows)), [len(each) for each in found])
    point = np.concatenate([np.asarray(each, np.int64) for each in found])
    is_other = (point < clusters.first[rows][row]) | (point >= clusters.stop[rows][row])
    row, point = row[is_other], point[is_other]
    away = centroid[rows] / np.maximum(np.hypot(*centroid[rows].T), LEAST_M)[:, None]
    offset = clusters.points_m[point] - centroid[rows][row]
    reach = np.maximum(np.hypot(*offset.T) - width[rows][row] / 2, 0)
    alone, beside = np.full((2, len(rows)), AROUND_M)
    np.minimum.at(alone, row, reach)
    is_beside = np.einsum("ij,ij->i", offset, away[row]) < FACE_M
    np.minimum.at(beside, row[is_beside], reach[is_beside])
    spacing = clusters.range_m[point] * abs(scan.angle_step_rad)
    crowds = [np.bincount(row, spacing * (reach < within), len(rows)) for within in CROWDED_M]
    is_wall = reach < WALL_M
    return np.array([alone, beside, *crowds, *_wall(row[is_wall], offset[is_wall], len(rows))])


def _wall(row: NDArray[np.int64], offset: Values, rows: int) -> tuple[Values, Values]:
    """How far the origin is from the line through points, and how wide they lie about it, by their length.

    row, offset  (p,), (p, 2) of which row each point is, and where
    Each (rows,); both are 1 where there are fewer than three points.
    """
    count = np.bincount(row, minlength=rows)
    x, y = offset.T
    mean_x, mean_y, xx, yy, xy = (
        np.bincount(row, each, rows) / np.maximum(count, 1) for each in (x, y, x * x, y * y, x * y)
    )
    xx, yy, xy = xx - mean_x**2, yy - mean_y**2, xy - mean_x * mean_y
    turn = np.arctan2(2 * xy, xx - yy) / 2
    off = np.abs(mean_y * np.cos(turn) - mean_x * np.sin(turn))
    middle, half = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    spread = np.sqrt(np.maximum(middle - half, 0) / np.maximum(middle + half, LEAST_M**2))
    is_line = count >= 3
    return np.where(is_line, np.minimum(off, AROUND_M), AROUND_M), np.where(is_line, spread, 1.0)
