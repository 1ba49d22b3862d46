"""Unions that GEOS cannot refuse.

Its exact noding fails, rarely, where segments are collinear but for float noise. Snapped to a grid far finer
than anything that is asked of the result it cannot.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

GRID_M = 1e-9


def united(shapes: Sequence[shapely.Geometry] | NDArray[np.object_]) -> shapely.Geometry:
    """The union of lines or areas; corners move by at most GRID_M where GEOS fails without."""
    try:
        return shapely.union_all(shapes)
    except shapely.errors.GEOSException:
        return shapely.union_all(shapes, grid_size=GRID_M)
