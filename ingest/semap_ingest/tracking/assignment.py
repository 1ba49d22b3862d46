"""Which detection belongs to which track, all of them at once.

A pair is made only where it is cheaper than leaving both alone; what cannot be is never made. As an
assignment problem: with the price of leaving both alone as zero, pairs that cost more count zero too, and
the cheapest complete assignment of the smaller side, less its pairs of zero, is the cheapest partial one.
No large numbers stand for "forbidden", so that a forbidden pair cannot push a good one aside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Indices = NDArray[np.int64]


def assign(cost: NDArray[np.float64], alone: NDArray[np.float64] | float) -> tuple[Indices, Indices]:
    """The partial assignment of least cost, where a pair left alone costs `alone`.

    cost     (n, m), of tracks (rows) to detections; infinite or NaN: cannot be
    alone    (n, 1) or one for all; a pair must cost less than this
    returns  rows and columns of the pairs, rows ascending
    """
    with np.errstate(invalid="ignore"):
        saved = np.minimum(cost - alone, 0.0)
    saved[~np.isfinite(cost)] = 0.0
    rows, columns = linear_sum_assignment(saved)
    is_pair = saved[rows, columns] < 0.0
    return rows[is_pair].astype(np.int64), columns[is_pair].astype(np.int64)


def unassigned(count: int, taken: Indices) -> Indices:
    """Those of `count` that are not among `taken`, ascending."""
    is_free = np.ones(count, np.bool_)
    is_free[taken] = False
    return np.flatnonzero(is_free)
