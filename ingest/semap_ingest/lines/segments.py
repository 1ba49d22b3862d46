"""Lines in a scan: it is split into straight pieces, those of one line are merged, each is fitted.

Split and merge as compared by Nguyen et al. 2007, with a statistical test in both steps: whether points lie
about a line as noise of the ranges explains decides, not a distance. A leaf that is set back in its wall by
a few centimetres is therefore a line of its own, though it is almost parallel to the wall and next to it.

What it promises: no I/O, the same lines for the same scan, each of at least `min_points` points and
`min_length_m`, straight as far as the sensor can tell. What it does not: a leaf flush with its wall is part
of the wall, and motion of the sensor during a sweep is not taken into account.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semap_ingest.laser.clusters import beams_that_hit
from semap_ingest.lines.moments import Fits, Moments, fit, moments_of, sums_before
from semap_ingest.lines.split import jumps, split
from semap_ingest.sensing.lines import Lines
from semap_ingest.sensing.scan import Scan

MERGED = 13.8
"""Chi-square of two parameters at one in a thousand: above it, two pieces are not one line."""

OUTLYING = 3.0
"""Standard deviations from its line at which a point at the end of a piece belongs to something else."""

SHORTENED = 0.5
"""As long as a part of itself from above, a line goes up."""


@dataclass(frozen=True)
class LineSettings:
    """What a line is.

    range_std_m   noise of a range, one standard deviation
    flatness_m    what surfaces deviate from a plane, and what else is not noise of the range
    jump_m        how far apart neighbours may be beyond what a wall at `grazing_rad` explains
    gap_m         how far apart two pieces of one line may end
    """

    min_points: int = 5
    min_length_m: float = 0.25
    range_std_m: float = 0.015
    flatness_m: float = 0.003
    jump_m: float = 0.06
    grazing_rad: float = 0.17
    gap_m: float = 0.3


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Points `first` to `last` of the scan, both included, with the moments of those that count."""

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    moments: Moments


def find_lines(scan: Scan, settings: LineSettings = LineSettings()) -> Lines:
    """Lines in the laser's frame, counter-clockwise: the same ones, whichever way the laser turns."""
    beam = beams_that_hit(scan)
    if len(beam) < settings.min_points:
        return _no_lines(scan)
    points = scan.points_m[beam]
    sums = sums_before(moments_of(points))
    ranges = scan.ranges_m[beam].astype(np.float64)
    begins = jumps(ranges, beam, scan.angle_step_rad, settings.grazing_rad, settings.jump_m)
    starts = split(points, sums, np.flatnonzero(begins), settings.range_std_m, settings.flatness_m)
    ends = np.append(starts[1:], len(points))
    starts, ends = _shift_borders(starts, ends, begins, sums, settings)
    run = np.cumsum(begins)
    pieces = _trimmed(starts, ends, points, sums, settings)
    pieces = _merged(pieces, run[pieces.first[1:]] == run[pieces.last[:-1]], settings)
    # once more without what is no line: a leg before a wall does not cut it in two
    pieces = _only_lines(pieces, points, settings)
    gap = points[pieces.first[1:]] - points[pieces.last[:-1]]
    pieces = _merged(pieces, np.hypot(gap[:, 0], gap[:, 1]) <= settings.gap_m, settings)
    return _lines(scan, pieces, points, settings)


def transform_lines(lines: Lines, map_T_laser: NDArray[np.float64], frame: str) -> Lines:
    """The same lines in another frame, seen from above.

    A tilted laser sees some lines that go up rather than along; what is less than half as long from above is
    left out.

    map_T_laser  (4, 4)
    """
    moved_m = lines.ends_m @ map_T_laser[:2, :2].T + map_T_laser[:2, 3]
    goes_along = _lengths(moved_m) >= SHORTENED * _lengths(lines.ends_m)
    return Lines(
        lines.stamp_us,
        frame,
        moved_m[goes_along],
        lines.angle_std_rad[goes_along],
        lines.offset_std_m[goes_along],
        lines.points[goes_along],
    )


def _lengths(ends_m: NDArray[np.float64]) -> NDArray[np.float64]:
    apart = ends_m[:, 1] - ends_m[:, 0]
    return np.asarray(np.hypot(apart[:, 0], apart[:, 1]))


def _no_lines(scan: Scan) -> Lines:
    return Lines(
        scan.stamp_us, scan.frame, np.empty((0, 2, 2)), np.empty(0), np.empty(0), np.empty(0, dtype=np.int64)
    )


def _shift_borders(
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    begins: NDArray[np.bool_],
    sums: Moments,
    settings: LineSettings,
    reach: int = 6,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Put the border of two pieces of a run where both fit best: a split need not have met the corner."""
    starts, ends = starts.copy(), ends.copy()
    inner = np.flatnonzero(~begins[starts])
    # every other border at a time, so that none moves while its neighbour does
    for turn in (inner[::2], inner[1::2]):
        if len(turn) == 0:
            continue
        borders = starts[turn][:, None] + np.arange(-reach, reach + 1)
        low, high = starts[turn - 1][:, None], ends[turn][:, None]
        allowed = (borders >= low + 2) & (borders <= high - 2)
        safe = np.where(allowed, borders, starts[turn][:, None])
        shape = (-1, sums.shape[1])
        cost = np.zeros(borders.shape)
        for sides in (sums[safe] - sums[low], sums[high] - sums[safe]):
            moments = sides.reshape(shape)
            moments[:, 0] = np.maximum(moments[:, 0], 1)
            fits = fit(moments, settings.range_std_m, settings.flatness_m)
            cost += (fits.squares_m2 / fits.variance_m2).reshape(borders.shape)
        cost[~allowed] = np.inf
        best = np.where(allowed.any(axis=1), safe[np.arange(len(turn)), cost.argmin(axis=1)], starts[turn])
        starts[turn] = best
        ends[turn - 1] = best
    return starts, ends


def _trimmed(
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    points: NDArray[np.float64],
    sums: Moments,
    settings: LineSettings,
) -> _Pieces:
    """Pieces of enough points to be judged, without those at their ends that an edge made."""
    kept = ends - starts >= 3
    starts, ends = starts[kept], ends[kept]
    for _ in range(2):
        fits = fit(sums[ends] - sums[starts], settings.range_std_m, settings.flatness_m)
        limit = OUTLYING * np.sqrt(fits.variance_m2)
        wide = ends - starts > 4
        starts = starts + (wide & (_aside(points[starts], fits) > limit))
        ends = ends - (wide & (_aside(points[ends - 1], fits) > limit))
    return _Pieces(starts, ends - 1, sums[ends] - sums[starts])


def _aside(points: NDArray[np.float64], fits: Fits) -> NDArray[np.float64]:
    """(n,) how far each point lies off the line of the same place."""
    apart = points - fits.middle_m
    return np.abs(apart[:, 1] * fits.direction[:, 0] - apart[:, 0] * fits.direction[:, 1])


def _merged(pieces: _Pieces, near: NDArray[np.bool_], settings: LineSettings) -> _Pieces:
    """Neighbours that are one line made one, the likeliest first, until none are left.

    near  (n - 1,) whether each piece and the next may be one
    """
    first, last, moments = pieces.first, pieces.last, pieces.moments
    squares_m2 = fit(moments, settings.range_std_m, settings.flatness_m).squares_m2
    while near.any():
        both = fit(moments[:-1] + moments[1:], settings.range_std_m, settings.flatness_m)
        rise = (both.squares_m2 - squares_m2[:-1] - squares_m2[1:]) / both.variance_m2
        rise[~near] = np.inf
        around = np.concatenate([[np.inf], rise, [np.inf]])
        join = np.flatnonzero((rise < MERGED) & (rise < around[:-2]) & (rise <= around[2:]))
        if len(join) == 0:
            break
        moments, last, squares_m2 = moments.copy(), last.copy(), squares_m2.copy()
        moments[join] += moments[join + 1]
        last[join], squares_m2[join] = last[join + 1], both.squares_m2[join]
        kept = np.ones(len(first), np.bool_)
        kept[join + 1] = False
        first, last, moments, squares_m2 = first[kept], last[kept], moments[kept], squares_m2[kept]
        near = near[kept[1:]]
    return _Pieces(first, last, moments)


def _only_lines(pieces: _Pieces, points: NDArray[np.float64], settings: LineSettings) -> _Pieces:
    """The pieces that are long enough, and as straight as noise lets a line be."""
    fits = fit(pieces.moments, settings.range_std_m, settings.flatness_m)
    apart = points[pieces.last] - points[pieces.first]
    length = np.abs(np.einsum("ij,ij->i", apart, fits.direction))
    is_line = (
        (fits.count >= settings.min_points)
        & (length >= settings.min_length_m)
        & (fits.squares_m2 <= 4 * fits.variance_m2 * np.maximum(fits.count - 2, 1))
    )
    return _Pieces(pieces.first[is_line], pieces.last[is_line], pieces.moments[is_line])


def _lines(scan: Scan, pieces: _Pieces, points: NDArray[np.float64], settings: LineSettings) -> Lines:
    """The pieces with their covariance (Arras and Siegwart 1997).

    The variance across the line is that of the points' noise, or of their residual where that is larger.
    """
    if len(pieces.first) == 0:
        return _no_lines(scan)
    fits = fit(pieces.moments, settings.range_std_m, settings.flatness_m)
    along = [
        np.einsum("ij,ij->i", points[place] - fits.middle_m, fits.direction)
        for place in (pieces.first, pieces.last)
    ]
    variance = np.maximum(fits.variance_m2, fits.squares_m2 / np.maximum(fits.count - 2, 1))
    halfway = (along[0] + along[1]) / 2
    return Lines(
        scan.stamp_us,
        scan.frame,
        np.stack([fits.middle_m + each[:, None] * fits.direction for each in along], axis=1),
        np.sqrt(variance / fits.spread_m2),
        np.sqrt(variance / fits.count + halfway**2 * variance / fits.spread_m2),
        fits.count.astype(np.int64),
    )
