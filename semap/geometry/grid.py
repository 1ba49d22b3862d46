"""A grid over the plane that answers for many boxes at once how many marked cells each touches.

The counts are sums over a table of prefix sums: four look-ups for a box, whatever its size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

CELLS = 512
"""On each side of the grid."""


@dataclass(frozen=True, eq=False)
class Grid:
    """CELLS x CELLS cells from a corner on.

    low_m     (2,) [m]
    scale     (2,) [cells per metre]
    """

    low_m: NDArray[np.float64]
    scale: NDArray[np.float64]

    def cells_of(self, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """The cells (n, 2) of points (n, 2); points outside get the nearest cell outside, -1 or CELLS."""
        return np.clip(np.floor((points_m - self.low_m) * self.scale), -1, CELLS).astype(np.int64)

    def counts_in(
        self, sums: NDArray[np.int64], low_m: NDArray[np.float64], high_m: NDArray[np.float64]
    ) -> NDArray[np.int64]:
        """How many marks lie in the cells that boxes (n, 2) to (n, 2) touch; see `prefix_sums`."""
        first, last = self.cells_of(low_m) + 1, self.cells_of(high_m) + 2
        counts: NDArray[np.int64] = (
            sums[last[:, 0], last[:, 1]]
            - sums[first[:, 0], last[:, 1]]
            - sums[last[:, 0], first[:, 1]]
            + sums[first[:, 0], first[:, 1]]
        )
        return counts


def grid_over(points_m: NDArray[np.float64]) -> Grid:
    """The grid that just holds the points (n, 2), n >= 1."""
    low_m, high_m = points_m.min(axis=0), points_m.max(axis=0)
    return Grid(low_m, CELLS / np.maximum((high_m - low_m) * (1 + 1e-9), 1e-9))


def prefix_sums(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Sums of counts (CELLS + 2, CELLS + 2), whose first and last rows and columns are the outside."""
    sums = np.zeros((CELLS + 3, CELLS + 3), dtype=np.int64)
    sums[1:, 1:] = counts.cumsum(axis=0).cumsum(axis=1)
    return sums


def point_counts(grid: Grid, points_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """How many of the points (n, 2) lie in each cell, with the outside around: (CELLS + 2, CELLS + 2)."""
    flat = (grid.cells_of(points_m) + 1) @ np.array([CELLS + 2, 1])
    return np.bincount(flat, minlength=(CELLS + 2) ** 2).reshape(CELLS + 2, CELLS + 2)


def bounds_of(corners_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest coordinates (n, 2) of shapes with k corners each (n, k, 2)."""
    # Several times as fast as a reduction over so short an axis.
    low_m = high_m = corners_m[:, 0]
    for place in range(1, corners_m.shape[1]):
        low_m, high_m = np.minimum(low_m, corners_m[:, place]), np.maximum(high_m, corners_m[:, place])
    return low_m, high_m


def classified(
    grid: Grid, region: shapely.Geometry, margin_m: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which cells the boundary of a region comes near, and which lie wholly inside it.

    margin_m  a boundary within it counts as touching
    returns   two tables (CELLS + 2, CELLS + 2), with the outside around
    """
    # Pieces shorter than a cell touch no cell outside their own box.
    pieces = shapely.get_parts(shapely.segmentize(region.boundary, 1 / float(grid.scale.max())))
    points_m, line = shapely.get_coordinates(pieces, return_index=True)
    joined = line[1:] == line[:-1]
    low = grid.cells_of(np.minimum(points_m[:-1], points_m[1:])[joined] - margin_m) + 1
    high = grid.cells_of(np.maximum(points_m[:-1], points_m[1:])[joined] + margin_m) + 1
    touched = np.zeros((CELLS + 2, CELLS + 2), dtype=bool)
    reach = int((high - low).max(initial=0)) + 1
    for right in range(reach):
        for up in range(reach):
            touched[np.minimum(low[:, 0] + right, high[:, 0]), np.minimum(low[:, 1] + up, high[:, 1])] = True
    inside = np.zeros_like(touched)
    across, upwards = np.nonzero(~touched[1:-1, 1:-1])
    middles_m = grid.low_m + (np.column_stack([across, upwards]) + 0.5) / grid.scale
    shapely.prepare(region)
    inside[across + 1, upwards + 1] = shapely.contains_xy(region, middles_m[:, 0], middles_m[:, 1])
    return touched, inside
