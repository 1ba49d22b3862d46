"""The heights that belong to a room, by its storey.

A drawn room often ends at the suspended ceiling, or begins at the finished floor; a person's position
may be measured a little below one or above the other. So:

* a room begins at its storey's elevation if its body begins within `SNAP_M` of it, else at its body's
  bottom;
* it ends at the elevation of the next storey above if its body ends below that, or at most `SNAP_M`
  above it, else (a room over several storeys) at its body's top.

Bands are half open, so that rooms of stacked storeys do not overlap.
"""

from __future__ import annotations

from collections.abc import Iterable

from semap.model.building import HeightBand

SNAP_M = 0.5


def band_by_storey(
    bottom_m: float, top_m: float, elevation_m: float | None, elevations_m: Iterable[float]
) -> HeightBand:
    """The band of a room from its body's bottom and top.

    elevation_m   that of its storey; None: the room is on no storey and keeps its body's heights
    elevations_m  those of all storeys
    """
    if elevation_m is None:
        return HeightBand(bottom_m, top_m)
    z_min_m = elevation_m if abs(bottom_m - elevation_m) <= SNAP_M else bottom_m
    # A storey that begins below the body cannot end it.
    above = [other for other in elevations_m if other > max(elevation_m, bottom_m)]
    if above and top_m <= min(above) + SNAP_M:
        return HeightBand(z_min_m, min(above))
    return HeightBand(z_min_m, top_m)
