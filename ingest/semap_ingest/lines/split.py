"""Where a scan's points break into straight pieces: at jumps of the range, and where they leave the chord.

Borges and Aldon 2004 (adaptive breakpoints), Duda and Hart 1973 (iterative end point fit). All pieces are
split at once, level by level, so that the work is a handful of operations on whole scans.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from semap_ingest.lines.moments import Moments, fit


def jumps(
    range_m: NDArray[np.float64],
    beam: NDArray[np.int64],
    angle_step_rad: float,
    grazing_rad: float,
    jump_m: float,
) -> NDArray[np.bool_]:
    """(n,) whether a new run begins at each point: a wall seen at `grazing_rad` or more does not break.

    range_m, beam  (n,) of the points, in the order of the beams
    """
    turn_rad = np.diff(beam) * abs(angle_step_rad)
    reach = (
        np.minimum(range_m[1:], range_m[:-1])
        * np.sin(turn_rad)
        / np.sin(np.maximum(grazing_rad - turn_rad, 0.02))
    )
    squared = range_m[1:] ** 2 + range_m[:-1] ** 2 - 2 * range_m[1:] * range_m[:-1] * np.cos(turn_rad)
    apart = np.sqrt(np.maximum(squared, 0))
    return np.concatenate([[True], (apart > reach + jump_m) | (turn_rad > grazing_rad / 2)])


def split(
    points_m: NDArray[np.float64],
    sums: Moments,
    starts: NDArray[np.int64],
    range_std_m: float,
    flatness_m: float,
    max_levels: int = 24,
) -> NDArray[np.int64]:
    """The starts of straight pieces, of runs that start at `starts`; each point belongs to one piece.

    A piece is cut at the point farthest from its chord where that is farther than noise goes, or where its
    points lie about their best line worse than noise does.

    points_m  (n, 2) in the order of the beams
    sums      (n + 1, 9) as `sums_before` gives them
    """
    n = len(points_m)
    settled = np.zeros(n, dtype=np.bool_)
    for _ in range(max_levels):
        bounds = np.append(starts, n)
        length = np.diff(bounds)
        piece = np.repeat(np.arange(len(starts)), length)
        first, last = points_m[bounds[:-1]], points_m[bounds[1:] - 1]
        chord = last - first
        normal = np.column_stack([-chord[:, 1], chord[:, 0]])
        normal /= np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)[:, None]
        away = np.abs(np.einsum("ij,ij->i", points_m - first[piece], normal[piece]))
        farthest = np.maximum.reduceat(away, starts)
        fits = fit(sums[bounds[1:]] - sums[bounds[:-1]], range_std_m, flatness_m)
        free = np.maximum(fits.count - 2, 1)
        excess = fits.squares_m2 / fits.variance_m2 > free + 3.5 * np.sqrt(2 * free)
        # the ends of the chord are noisy too
        wanted = (length >= 4) & ((farthest > 5 * np.sqrt(fits.variance_m2)) | excess) & ~settled[starts]
        if not wanted.any():
            break
        candidates = np.flatnonzero(wanted[piece] & (away >= farthest[piece]))
        _, one = np.unique(piece[candidates], return_index=True)
        cuts = candidates[one]
        # the farthest point opens the second piece; a cut leaves two points on either side where it can
        cuts = np.clip(cuts, bounds[piece[cuts]] + 1, bounds[piece[cuts] + 1] - 1)
        settled[starts[~wanted]] = True
        starts = np.union1d(starts, cuts)
    return starts
