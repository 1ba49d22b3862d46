"""The twelve regions around a thing in which others are in front of it, behind, left, right, above, below.

They start from its extents along the axes of its own frame (REP 103: x forward, y left, z up) and point
outwards from one of its six faces:

* a Projection is the face swept outwards by the reach: what is straight ahead;
* a Halfspace is everything beyond the plane of the face, cut off at the reach on all sides: the face grown
  by the reach in its plane, swept outwards by the reach.

The face itself belongs to both, so that what touches it is in front of it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from semap.errors import InvalidInput
from semap.geometry.oriented_box import box_mesh
from semap.model.building import Mesh

SIDES: Mapping[str, tuple[int, int]] = {
    "Front": (0, 1),
    "Back": (0, -1),
    "Left": (1, 1),
    "Right": (1, -1),
    "Top": (2, 1),
    "Bot": (2, -1),
}
"""Axis and sign of the normal of each face."""

SPREADS: Mapping[str, float] = {"Projection": 0.0, "Halfspace": 1.0}
"""By how many reaches a region is wider than its face, on each side."""

DIRECTIONS = tuple(side + spread for spread in SPREADS for side in SIDES)


def direction_region(direction: str, low_m: ArrayLike, high_m: ArrayLike, reach_m: float) -> Mesh:
    """One region, as a closed box of twelve triangles, wound outwards, in the thing's own frame.

    direction      one of DIRECTIONS
    low_m, high_m  (3,) extents of the thing along its own axes [m]; it may be flat
    raises         InvalidInput for another direction, extents that are not in order, a reach that is not
                   greater than zero
    """
    low, high = (np.asarray(each, dtype=np.float64) for each in (low_m, high_m))
    if direction not in DIRECTIONS:
        raise InvalidInput(f"no direction is called {direction!r}", f"Give one of {', '.join(DIRECTIONS)}.")
    if (
        low.shape != (3,)
        or high.shape != (3,)
        or not (np.isfinite([low, high]).all() and (low <= high).all())
    ):
        raise InvalidInput("extents that are not in order", "Give the lowest and the highest corner.")
    if not (np.isfinite(reach_m) and reach_m > 0):
        raise InvalidInput(f"a reach of {reach_m} m", "Give a reach greater than zero.")
    side, spread = next((side, spread) for side in SIDES for spread in SPREADS if side + spread == direction)
    axis, sign = SIDES[side]
    region_low = low - SPREADS[spread] * reach_m
    region_high = high + SPREADS[spread] * reach_m
    face_m = high[axis] if sign > 0 else low[axis]
    region_low[axis] = min(face_m, face_m + sign * reach_m)
    region_high[axis] = max(face_m, face_m + sign * reach_m)
    return box_mesh(region_low, region_high)


def direction_regions(low_m: ArrayLike, high_m: ArrayLike, reach_m: float) -> dict[str, Mesh]:
    """All twelve by name, in the order of DIRECTIONS; see `direction_region`."""
    return {name: direction_region(name, low_m, high_m, reach_m) for name in DIRECTIONS}
