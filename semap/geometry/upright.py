"""Bodies that stand upright between two heights, as most rooms do: their hull and boxes are known from above.

That takes a tenth of the time of a hull in space. What is thin is left to that, since it minds float noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Point, Polygon

from semap.geometry.oriented_box import box_mesh, smallest_rectangle
from semap.geometry.projection import cross_2d
from semap.model.building import Mesh

THIN = 1e-6
"""A body is thin if it is less high or, seen from above, less wide than this share of its extent."""

NOISE = 1e-9
"""Or than this share of how far it lies from the origin."""

STRAIGHT = 1e-12
"""Two sides that span less than this share of the square of the extent meet at no corner but for noise."""


@dataclass(frozen=True, eq=False)
class Upright:
    """The convex hull of a body between two heights.

    ground            seen from above
    ring_m            (n, 2) float64, its corners, counter-clockwise
    z_min_m, z_max_m  of the body
    """

    ground: Polygon
    ring_m: NDArray[np.float64]
    z_min_m: float
    z_max_m: float

    def hull(self) -> Mesh:
        """Closed, wound outwards; its corners are some of the body's, exactly."""
        return self._over(self.ring_m)

    def centroid(self) -> Point:
        """The centre of the hull's volume."""
        middle = self.ground.centroid
        return Point(middle.x, middle.y, (self.z_min_m + self.z_max_m) / 2)

    def axis_aligned_box(self) -> Mesh:
        """The smallest box along the axes."""
        x_min_m, y_min_m, x_max_m, y_max_m = self.ground.bounds
        low_m, high_m = (x_min_m, y_min_m, self.z_min_m), (x_max_m, y_max_m, self.z_max_m)
        return box_mesh(np.array(low_m), np.array(high_m))

    def smallest_box(self) -> Mesh:
        """The smallest box: from each side the hull is a rectangle, so that it is found from above."""
        return self._over(smallest_rectangle(self.ring_m))

    def _over(self, ring_m: NDArray[np.float64]) -> Mesh:
        count = len(ring_m)
        corners_m = np.empty((2 * count, 3))
        corners_m[:count, :2] = corners_m[count:, :2] = ring_m
        corners_m[:count, 2], corners_m[count:, 2] = self.z_min_m, self.z_max_m
        return Mesh(corners_m, _faces(count))


def upright(points_m: NDArray[np.float64]) -> Upright | None:
    """The hull of points (n, 3), n >= 1, where they are two layers with the same points in the same order.

    None where they are not, or are thin, or where float noise alone makes a corner.
    """
    low_m, high_m = float(points_m[:, 2].min()), float(points_m[:, 2].max())
    is_low, is_high = points_m[:, 2] == low_m, points_m[:, 2] == high_m
    layer_m = points_m[is_low, :2]
    if not (is_low ^ is_high).all() or not np.array_equal(layer_m, points_m[is_high, :2]):
        return None
    ground = shapely.convex_hull(shapely.multipoints(layer_m))
    if not isinstance(ground, Polygon):
        return None
    extent_m = max(high_m - low_m, ground.length / 2)
    least_m = max(THIN * extent_m, NOISE * float(np.abs(points_m).max()))
    if min(high_m - low_m, ground.area / ground.length) <= least_m:
        return None
    closed_m = shapely.get_coordinates(ground)
    sides_m = closed_m[1:] - closed_m[:-1]
    turns_m2 = cross_2d(sides_m, np.concatenate([sides_m[1:], sides_m[:1]]))
    if np.abs(turns_m2).min() <= STRAIGHT * extent_m**2:
        return None
    return Upright(ground, closed_m[:-1] if turns_m2[0] > 0 else closed_m[:0:-1], low_m, high_m)


@lru_cache(maxsize=64)
def _faces(count: int) -> NDArray[np.int64]:
    """The triangles of a prism over a convex ring of so many corners: first those below, then those above."""
    here = np.arange(count)
    following = np.roll(here, -1)
    corner = here[1:-1]
    below = np.column_stack([np.zeros_like(corner), corner + 1, corner])
    walls = np.concatenate(
        [
            np.column_stack([here, following, following + count]),
            np.column_stack([here, following + count, here + count]),
        ]
    )
    faces = np.concatenate([below, below[:, ::-1] + count, walls])
    faces.setflags(write=False)
    return faces
