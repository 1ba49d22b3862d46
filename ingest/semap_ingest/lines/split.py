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
    turn_rad = np.abs(np.diff(beam) * angle_step_rad)
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
    found = [starts]
    stops = np.append(starts[1:], len(points_m))
    for _ in range(max_levels):
        is_long = stops - starts >= 4
        starts, stops = starts[is_long], stops[is_long]
        if not len(starts):
            break
        is_cut, cuts = _cuts(points_m, sums, starts, stops, range_std_m, flatness_m)
        found.append(cuts)
        starts, stops = np.concatenate([starts[is_cut], cuts]), np.concatenate([cuts, stops[is_cut]])
    return np.sort(np.concatenate(found))


def _cuts(
    points_m: NDArray[np.float64],
    sums: Moments,
    starts: NDArray[np.int64],
    stops: NDArray[np.int64],
    range_std_m: float,
    flatness_m: float,
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which of the pieces (k,) are cut, and where each of those is: the point that opens its second part."""
    length = stops - starts
    offset = np.cumsum(length) - length
    piece = np.repeat(np.arange(len(starts)), length)
    member = np.repeat(starts - offset, length) + np.arange(len(piece))
    first, last = points_m[starts], points_m[stops - 1]
    chord = last - first
    normal = np.column_stack([-chord[:, 1], chord[:, 0]])
    normal /= np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-9)[:, None]
    away = np.abs(np.einsum("ij,ij->i", points_m[member] - first[piece], normal[piece]))
    farthest = np.maximum.reduceat(away, offset)
    fits = fit(sums[stops] - sums[starts], range_std_m, flatness_m)
    free = np.maximum(fits.count - 2, 1)
    excess = fits.squares_m2 / fits.variance_m2 > free + 3.5 * np.sqrt(2 * free)
    # the ends of the chord are noisy too
    is_cut = (farthest > 5 * np.sqrt(fits.variance_m2)) | excess
    candidates = np.flatnonzero(is_cut[piece] & (away >= farthest[piece]))
    of = piece[candidates]
    candidates = candidates[np.concatenate([[True], of[1:] != of[:-1]])[: len(of)]]
    # one point at least stays on either side
    return is_cut, np.clip(member[candidates], starts[is_cut] + 1, stops[is_cut] - 1)
